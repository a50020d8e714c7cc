"""Step 7: take away; report, model for elsewhere, and the commands and the notebook that made all this."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

from nicegui import ui

from .takeaway import COMMANDS, NOTEBOOK, commands, notebook, pack, write
from .work import REPORT

if TYPE_CHECKING:
    from .page import Page

TARGETS = ("c", "casadi", "fmu", "acados", "simulink", "f1tenth", "ros2", "autoware")


async def prepare(page: Page) -> dict[str, Any]:
    """Commands and notebook, written anew."""
    await page.off(write, page.session)
    return {"commands": commands(page.session), "notebook": notebook(page.session)}


def draw(page: Page, data: dict[str, Any]) -> None:
    """The step."""
    from .page import guarded, heading, title

    session, work = page.session, page.work
    heading(
        "Take it away",
        "Everything that was done is a command; run in another folder with the same files they make the same fit.",
    )
    with ui.element("div").classes("two"):
        with ui.column():
            title("Commands")
            ui.code(data["commands"], language="bash").classes("w-full").mark("commands")
            title("Notebook")
            cells = "\n\n".join(
                "".join(cell["source"]) for cell in data["notebook"]["cells"] if cell["cell_type"] == "code"
            )
            ui.code(cells, language="python").classes("w-full").mark("notebook")
        with ui.column():
            title("Everything in one file")
            ui.button("Pack it", on_click=guarded(page, partial(_pack, page))).props("no-caps").mark("pack")
            with ui.row():
                for name in (COMMANDS, NOTEBOOK):
                    ui.link(name, f"/session/{name}", new_tab=True)
            title("Report")
            if session["fit"]:
                ui.button("Write the report", on_click=guarded(page, work.report)).props("no-caps").mark("report")
                job = session.latest("report")
                if job is not None and job.failure:
                    ui.label(job.failure).classes("quiet")
                if job is not None and not job.running and (session.folder / REPORT).is_file():
                    ui.link("Open the report", f"/session/{REPORT}?{job.pid}", new_tab=True).mark("open-report")
            else:
                ui.label("There is no fit yet.")
            if session["gap"]:
                for name, words in (
                    ("gap.pdf", "The diagnosis as PDF"),
                    ("closed.toml", "The vehicle with the gap closed"),
                ):
                    if (session.folder / session["gap"] / name).is_file():
                        ui.link(words, f"/session/{session['gap']}/{name}", new_tab=True)
            title("Model for elsewhere")
            if session["fit"]:
                with ui.row(align_items="center"):
                    target = (
                        ui.select(list(TARGETS), value="c", label="target").props("dense outlined").style("width: 9rem")
                    )
                    ui.button("Export", on_click=guarded(page, lambda: work.export(target.value))).props(
                        "no-caps outline"
                    ).mark("export")
                for job in [each for each in session.jobs.all() if each.kind == "export" and not each.running]:
                    ui.label(job.failure or f"Written: {session.folder.name}/{job.target}").classes("quiet")
            title("This session")
            ui.label(f"It lies in {session.folder}; the command line reads it.").classes("quiet")


async def _pack(page: Page) -> None:
    name = await page.off(pack, page.session)
    ui.download.file(page.session.folder / name)
