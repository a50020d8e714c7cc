"""What the page shows and does, without a browser: NiceGUI's simulated user."""

import asyncio
from contextlib import asynccontextmanager
from pathlib import Path

import pytest

import greybox_id as gb

pytest.importorskip("nicegui", reason="The page needs the extra app.")
from nicegui import ui
from nicegui.testing.user_simulation import user_simulation

from greybox_lab.app import step_drop
from greybox_lab.app.page import Page
from greybox_lab.app.session import Session
from greybox_lab.app.steps import MODULES
from greybox_lab.app.work import Work

QUESTION = {
    "signal": "v_x", "column": "Speed", "unit": "m/s", "units": [], "sign": 1, "divide_by": 3890.0, "decided": False,
    "reasons": ["counts, such as a motor's rpm"], "use": None,
}  # fmt: skip


@pytest.fixture
def work(tmp_path, _uncompiled):
    session = Session(tmp_path / "racer")
    for name in ("racer_train", "racer_valid"):
        session.link(Path(gb.datasets.shipped(name)))
    session.change(columns="roboracer")
    return Work(session)


@asynccontextmanager
async def opened(work):
    async def root():
        Page(work, MODULES).build()

    async with user_simulation(root) as user:
        await user.open("/")
        yield user


def run(scenario):
    asyncio.run(asyncio.wait_for(scenario(), 300))


async def seen(user, text):
    await user.should_see(text, retries=400)


def test_without_recordings_it_offers_the_shipped_ones(tmp_path):
    work = Work(Session(tmp_path / "empty"))

    async def scenario():
        async with opened(work) as user:
            await seen(user, "Take the shipped racer")
            for k in range(1, 7):
                assert not next(iter(user.find(f"step-{k}").elements)).enabled

    run(scenario)


def test_a_question_is_answered_by_a_button(work):
    base = {"time": {"column": "t", "unit": "s"}}
    work.session.change(columns="map.toml", map=base, entries=[QUESTION])

    async def scenario():
        async with opened(work) as user:
            await seen(user, "Answer 1 question about columns.")
            await seen(user, "Is “Speed” v_x, the longitudinal velocity?")
            user.find("yes-v_x-m/s").click()
            await seen(user, "Every column has its signal.")

    run(scenario)
    speed = gb.read(work.session.folder / "recordings/racer_train.csv", columns=work.session.folder / "map.toml")["v_x"]
    assert 3.5 < speed.max() < 4.5


def test_the_fit_is_locked_until_the_check_was_looked_at(work):
    async def scenario():
        async with opened(work) as user:
            await seen(user, "Read through the map roboracer.")
            user.find("onward").click()
            await seen(user, "See what was recorded")
            assert not next(iter(user.find("step-3").elements)).enabled
            work.session.change(looked=work.session.key)
            while not next(iter(user.find("step-3").elements)).enabled:
                await asyncio.sleep(0.02)
            user.find("step-3").click()
            await seen(user, "Which model?")
            work.session.change(between="1:20")  # another part has not been looked at
            await seen(user, "Can it be trusted?")

    run(scenario)
    work.session.jobs.stop()


def test_dragging_a_slider_simulates_anew_and_is_where_the_fit_starts(work):
    work.session.change(looked=work.session.key, step=3)

    async def scenario():
        async with opened(work) as user:
            await seen(user, "Which model?")
            before = next(iter(user.find("errors").elements)).text
            slider = next(iter(user.find("slider-m").elements))
            slider.set_value(2.5)
            while next(iter(user.find("errors").elements)).text == before:
                await asyncio.sleep(0.02)
            while not work.session["model"]["start"]:
                await asyncio.sleep(0.02)

    run(scenario)
    assert work.session["model"]["start"] == {"m": 2.5}
    assert work.fit_words("fits/1")[5:7] == ["--start", "m=2.5"]


def test_two_pages_show_the_same(work):
    async def scenario():
        async def root():
            Page(work, MODULES).build()

        async with user_simulation(root) as one:
            from nicegui.testing import User

            two = User(one.http_client)
            await one.open("/")
            await two.open("/")
            with two:
                await seen(two, "racer_valid.csv")
            with one:
                work.session.change(recordings=work.session["recordings"][:1])
            for user in (one, two):
                with user:
                    await user.should_not_see("racer_valid.csv", retries=400)

    run(scenario)


def test_a_step_that_fails_is_a_sentence_on_the_page(work, monkeypatch):
    async def prepare(page):
        raise RuntimeError("no such luck")

    monkeypatch.setattr(step_drop, "prepare", prepare)

    async def scenario():
        async with opened(work) as user:
            await seen(user, "This cannot be shown.")
            await seen(user, "no such luck")

    run(scenario)


def test_names_with_markup_are_words(work):
    name = "<img src=x onerror=alert(1)>.csv"
    work.session.change(recordings=[{"file": f"recordings/{name}", "role": "unused"}, *work.session["recordings"]])

    async def scenario():
        async with opened(work) as user:
            await seen(user, name)
            shown = [element for element in user.find(name).elements if isinstance(element, ui.label)]
            assert shown
            assert not any(isinstance(element, ui.html) for element in user.find(name).elements)

    run(scenario)
