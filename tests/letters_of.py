"""Where the letters of a drawn figure stand: boxes told from its SVG, to find those that are cut or meet."""

from xml.etree import ElementTree

from greybox_id.reports.plot.letters import width

SVG = "{http://www.w3.org/2000/svg}"


def boxes(svg):
    """(words, (left, top, right, bottom)) of every text, points, and the figure's width and height."""
    root = ElementTree.fromstring(svg)
    _, _, wide, high = (float(own) for own in root.get("viewBox").split())
    return list(_texts(root, 0.0, 0.0)), (wide, high)


def _texts(element, left, top):
    for child in element:
        if child.tag == f"{SVG}svg":
            yield from _texts(child, left + float(child.get("x")), top + float(child.get("y")))
        elif child.tag == f"{SVG}text":
            words, size = "".join(child.itertext()), float(child.get("font-size"))
            x, y = left + float(child.get("x")), top + float(child.get("y"))
            long = width(words, size) / 1.03
            before = {"start": 0.0, "middle": long / 2, "end": long}[child.get("text-anchor")]
            if "rotate" in child.get("transform", ""):
                yield words, (x - 0.7 * size, y - long + before, x + 0.2 * size, y + before)
            else:
                yield words, (x - before, y - 0.7 * size, x - before + long, y + 0.2 * size)
        elif child.tag == f"{SVG}g" and child.get("transform") is None:
            yield from _texts(child, left, top)


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
