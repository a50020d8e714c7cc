"""The page: everything is in it, nothing is fetched, it says what the PDF says; in a browser where there is one."""

import json
import re
import shutil
import subprocess
from html.parser import HTMLParser
from xml.etree import ElementTree

import pytest

from greybox_id.reports.figures.sheet import Sheet
from greybox_id.reports.html import POLICY, page, write_html
from greybox_id.reports.report import kind_of, prepared, write
from greybox_id.reports.words import spans

MEGABYTE = 1e6
CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
VOID = {"meta", "br", "img", "hr"}


class Seen(HTMLParser):
    """Tags in balance, attributes, text."""

    def __init__(self, text):
        super().__init__()
        self.open, self.attributes, self.words, self.tags = [], [], [], []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.attributes += attrs
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.tags.append(tag)
        self.attributes += attrs

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if self.open[-1:] != ["style"]:
            self.words.append(data)


@pytest.fixture(scope="module", params=["memory", "motion"])
def document(request):
    if request.param == "memory":
        return prepared(*(request.getfixturevalue(name) for name in ("small_fit",)), request.getfixturevalue("both"))
    return prepared(request.getfixturevalue("motion_fit"), request.getfixturevalue("laps"))


@pytest.fixture(scope="module")
def both(train, validate):
    return [train, validate]


@pytest.fixture(scope="module")
def text(document):
    return page(document)


def test_it_is_well_formed_small_and_the_same_every_time(document, text):
    assert Seen(text).open == []
    assert len(text.encode()) < 3 * MEGABYTE
    assert page(document) == text


def test_nothing_outside_the_page_is_named(text):
    seen = Seen(text)
    assert not {"script", "link", "iframe", "img", "object", "base", "form"} & set(seen.tags)
    for name, value in seen.attributes:
        assert name not in ("src", "xlink:href", "action", "srcset")
        assert name != "href" or value.startswith("#")
        assert not re.search(r"https?:|//", value or "") or name == "xmlns"
    assert not re.search(r"@import|url\((?!#)|expression\(", text)
    assert ("content", POLICY) in seen.attributes


def test_figures_and_equations_are_well_formed_and_described(document, text):
    figures = re.findall(r"<figure>(<svg.*?</svg>)(?=<figcaption|</figure>)", text, re.DOTALL)
    assert len(figures) == len(document.drawings) >= 8
    for svg in figures:
        root = ElementTree.fromstring(svg)
        assert root.find("{http://www.w3.org/2000/svg}title").text
        assert not re.search(r"[:\"] ?#[0-9a-f]{6}", svg)  # colours are the page's: light or dark
    equations = re.findall(r"<math.*?</math>", text, re.DOTALL)
    assert len(equations) >= 5
    for equation in equations:
        ElementTree.fromstring(equation)


def test_it_says_what_the_tree_says(document, text):
    words = "".join(Seen(text).words)
    for _, sentence in document.verdict:
        assert re.sub(r"[\s_,]", "", plain(sentence)) in re.sub(r"[\s_,]", "", words)
    for one in document.drawings:
        assert one.name in {drawing.name for drawing in document.drawings}
        assert "prefers-color-scheme" in text


def plain(sentence):
    return "".join(span.words + ",".join(span.index) for span in spans(sentence))


def test_words_from_files_are_no_markup():
    from greybox_id.reports.document import Document, Pairs, Table, Text

    evil = '<script>alert("x")</script> & <b>'
    parts = (Text(evil, lead=evil), Table((evil,), ((evil,),)), Pairs(((evil, evil), ("command", evil))))
    seen = Seen(page(Document(evil, evil, "a fit", evil, parts)))
    assert "script" not in seen.tags
    assert seen.open == []
    assert "".join(seen.words).count(evil) >= 8


def test_names_order_no_terminal():
    from greybox_id.reports.document import Document, Text

    text = page(Document("\x1b[2J", "car \x1b]0;x\x07", "a fit", "\u202egnp", (Text("\x9b2J", lead="\r"),)))
    assert not set("\x1b\x07\x9b\r\u202e") & set(text)


def test_the_file_s_name_says_what_it_is(small_fit, both, tmp_path):
    from greybox_id.base.errors import BadInput

    written = write(prepared(small_fit, both), tmp_path / "new" / "report.html")
    assert written.read_text("utf-8").startswith("<!DOCTYPE html>")
    assert kind_of("a.HTM") == "html"
    with pytest.raises(BadInput, match=r"a .pdf or a .html file"):
        kind_of("report.docx")
    with pytest.raises(BadInput, match="omit one of them"):
        kind_of("report.pdf", "html")


needs_chromium = pytest.mark.skipif(
    CHROMIUM is None, reason="no Chromium on this machine: the page was not opened in a browser"
)
QUIET = (
    "--headless --no-sandbox --disable-gpu --disable-quic --no-first-run --disable-background-networking "
    "--disable-component-update --disable-sync --disable-default-apps"
)
NOWHERE = "--host-resolver-rules=MAP * ~NOTFOUND"
"""Nothing that a page asks for leaves the machine; that it asked stands in the log."""
OWN = "not an origin"
"""Who asks where the browser asks for itself, as for updates."""


def asked_for(file, folder):
    """Addresses that a browser asks for when it opens a page, and the size of its picture."""
    log, picture = folder / "net.json", folder / "page.png"
    subprocess.run(
        [
            CHROMIUM, *QUIET.split(), NOWHERE, f"--user-data-dir={folder / 'profile'}", f"--log-net-log={log}",
            f"--screenshot={picture}", "--window-size=1000,4000", file.as_uri(),
        ],
        check=True, capture_output=True, timeout=120,
    )  # fmt: skip
    lines = (line for line in log.read_text("utf-8", errors="replace").splitlines() if '"initiator"' in line)
    events = [json.loads(line.rstrip(","))["params"] for line in lines]
    asked = [event for event in events if event["initiator"] != OWN]
    return {own["url"] for own in asked if not own["url"].startswith("file:")}, picture.stat().st_size


@needs_chromium
def test_a_browser_opens_it_without_a_request(document, tmp_path):
    addresses, size = asked_for(write_html(document, tmp_path / "report.html"), tmp_path)
    assert addresses == set()
    assert size > 50_000


@needs_chromium
def test_a_request_would_be_seen(tmp_path):
    (tmp_path / "asks.html").write_text('<img src="http://elsewhere.invalid/a.png">')
    addresses, _ = asked_for(tmp_path / "asks.html", tmp_path)
    assert addresses == {"http://elsewhere.invalid/a.png"}


@needs_chromium
def test_letters_of_a_type_that_stands_in_are_no_wider_than_the_layout_took_them_for(tmp_path):
    words = "yaw rate [rad/s] −0.25 1.00"
    sheet = Sheet((60.0,))
    sheet.first().set(title=words)
    drawn = sheet.svg()
    taken = sheet.first().title.get_window_extent(sheet.canvas.get_renderer()).width
    script = "document.title = [...document.querySelectorAll('text')].at(-1).getComputedTextLength()"
    (tmp_path / "one.html").write_text(
        f"<meta charset='utf-8'>{drawn.replace('Libertinus Serif', 'DejaVu Serif')}<script>{script}</script>"
    )
    call = [CHROMIUM, *QUIET.split(), f"--user-data-dir={tmp_path / 'profile'}", "--dump-dom"]
    seen = subprocess.run(
        [*call, (tmp_path / "one.html").as_uri()], check=True, capture_output=True, timeout=120, text=True
    ).stdout
    assert words in seen
    assert 0.8 * taken < float(re.search(r"<title>([\d.]+)</title>", seen)[1]) < 1.1 * taken
