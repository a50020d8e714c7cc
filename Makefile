# make demo   sets up an environment, fits the shipped recording, leaves a report in demo/
# make test   sets up an environment and runs the tests
# make check  format, lint, types, import floors, docstrings of the top level
# make docs   the site, into build/docs/html; executes the gallery, needs no network once the environment is there

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
export PYTHONDONTWRITEBYTECODE = # hundreds of processes are started by tests: each would compile the package again
SHIPPED := greybox_id/datasets/shipped

.PHONY: demo test check docs format clean

$(VENV)/done: pyproject.toml constraints.txt
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --upgrade pip
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --editable '.[all,docs,exam]' --group dev
	touch $@

demo: $(VENV)/done
	$(BIN)/greybox data check $(SHIPPED)/racer_train.csv --columns roboracer
	$(BIN)/greybox fit --model msnn_full $(SHIPPED)/racer_train.csv --columns roboracer \
		--validate $(SHIPPED)/racer_valid.csv --jobs 2 --out demo
	$(BIN)/greybox report demo/fit.json --out demo/report.pdf --figures demo/figures

test: $(VENV)/done
	$(BIN)/python -m pytest -n auto --dist worksteal $(PYTEST)

check: $(VENV)/done
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/python docs/docstrings.py
	$(BIN)/python docs/agents.py --check
	$(BIN)/python docs/results/build.py --check

docs: $(VENV)/done
	rm -rf docs/gallery docs/reference docs/made # pages of what is gone, figures of an older version
	$(BIN)/python -m sphinx --fail-on-warning --keep-going --quiet docs build/docs/html

format: $(VENV)/done
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

clean:
	rm -rf $(VENV) demo build dist *.egg-info docs/gallery docs/reference docs/made docs/sg_execution_times.rst
