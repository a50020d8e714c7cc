# make demo   sets up an environment, fits the shipped recording, leaves a report in demo/
# make test   sets up an environment and runs the tests
# make check  format, lint, types, import floors, pages of the top level

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
export PYTHONDONTWRITEBYTECODE = # hundreds of processes are started by tests: each would compile the package again
SHIPPED := greybox_id/datasets/shipped

.PHONY: demo test check format clean

$(VENV)/done: pyproject.toml constraints.txt
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --upgrade pip
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --editable '.[all,docs,exam]' --group dev
	touch $@

demo: $(VENV)/done
	$(BIN)/greybox data check $(SHIPPED)/racer_train.csv --columns roboracer
	$(BIN)/greybox fit --model msnn_full $(SHIPPED)/racer_train.csv --columns roboracer \
		--validate $(SHIPPED)/racer_valid.csv --out demo
	$(BIN)/greybox report demo/fit.json --out demo/report.pdf --figures demo/figures

test: $(VENV)/done
	$(BIN)/python -m pytest -n auto $(PYTEST)

check: $(VENV)/done
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/python docs/api/build.py --check

format: $(VENV)/done
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

clean:
	rm -rf $(VENV) demo build dist *.egg-info
