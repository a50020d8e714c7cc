"""Words of a PDF and their boxes: which lie over others, and which leave the page."""

ROOM = 1.0
"""Points by which boxes may meet: lines that follow each other closely, an index below its letter."""
ITALIC = "\U0001d400"
"""From here on letters are those of formulas, below whose slope an index may stand."""


def lines(page):
    """(words, (left, bottom, right, top)) of every rectangle of text that the PDF holds, points."""
    text = page.get_textpage()
    rectangles = [text.get_rect(k) for k in range(text.count_rects())]
    return [(text.get_text_bounded(*box).strip(), box) for box in rectangles]


def troubles(page):
    """Words beyond the page's edge, and pairs of words over each other."""
    wide, high = page.get_size()
    found = [(words, box) for words, box in lines(page) if words and max(words) < ITALIC]
    out = [words for words, (a, b, c, d) in found if a < 0 or b < 0 or c > wide or d > high]
    for k, (words, one) in enumerate(found):
        for others, other in found[k + 1 :]:
            across = min(one[2], other[2]) - max(one[0], other[0])
            upright = min(one[3], other[3]) - max(one[1], other[1])
            if min(across, upright) > ROOM:
                out.append((words, others))
    return out


def over_others(page):
    """Troubles but of a symbol with its own index: the PDF holds both, each with the words of the two."""
    return [one for one in troubles(page) if isinstance(one, str) or one[0] != one[1] or len(one[0]) > 3]
