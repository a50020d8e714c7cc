"""Where the letters of a drawn figure stand: boxes told from its SVG, to find those that are cut or meet."""

import re
from functools import cache
from xml.etree import ElementTree

import typst
from matplotlib.font_manager import FontProperties
from matplotlib.textpath import TextPath

SVG = "{http://www.w3.org/2000/svg}"
TYPE = FontProperties(family=["STIXGeneral", "DejaVu Sans"])


@cache
def width(words, size):
    """How wide words are, points."""
    return TextPath((0.0, 0.0), words, size, prop=TYPE).get_extents().x1


@cache
def drawn(words, size):
    """How wide they are in the type that pages are set in, points, as Typst measures it."""
    about = (
        f'#set text(font: "Libertinus Serif", size: {size}pt)\n#context [#metadata(measure("{words}").width.pt()) <w>]'
    )
    return float(typst.query(about.encode(), "<w>", field="value", one=True))


def boxes(svg):
    """(words, (left, top, right, bottom)) of every text, points, and the figure's width and height."""
    root = ElementTree.fromstring(svg)
    _, _, wide, high = (float(own) for own in root.get("viewBox").split())
    return [_box(text) for text in root.iter(f"{SVG}text")], (wide, high)


def _box(text):
    words, style, transform = "".join(text.itertext()), text.get("style"), text.get("transform", "")
    size = float(re.search(r"font-size: ([\d.]+)px", style)[1])
    moved = re.search(r"translate\((\S+) (\S+)\)", transform)
    x, y = (float(own) for own in (moved.groups() if moved else (text.get("x"), text.get("y"))))
    anchor = re.search(r"text-anchor: (\w+)", style)
    long = width(words, size)
    before = {"start": 0.0, "middle": long / 2, "end": long}[anchor[1] if anchor else "start"]
    if "rotate(-90" in transform:
        return words, (x - 0.7 * size, y - long + before, x + 0.2 * size, y + before)
    assert "rotate" not in transform
    return words, (x - before, y - 0.7 * size, x - before + long, y + 0.2 * size)


def troubles(svg, room=1.5):
    """Words that leave the figure, and pairs that overlap by more than `room` points in both directions."""
    found, (wide, high) = boxes(svg)
    out = [words for words, (a, b, c, d) in found if a < -room or b < -room or c > wide + room or d > high + room]
    for k, (words, one) in enumerate(found):
        for others, other in found[k + 1 :]:
            overlap = min(one[2], other[2]) - max(one[0], other[0]), min(one[3], other[3]) - max(one[1], other[1])
            if min(overlap) > room:
                out.append((words, others))
    return out
