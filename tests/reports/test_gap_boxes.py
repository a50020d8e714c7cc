"""A diagnosis of the worst names, as a PDF: no words lie over others, none leave the page, in the PDF's own boxes."""

from dataclasses import replace

import pypdfium2 as pdfium
import pytest
from made_gaps import DELAY, clear, closure, long_names

from greybox_id.fitting.provenance import DataRecord
from greybox_id.models.effects import EFFECTS
from greybox_id.reports.gap.report import write_report
from greybox_id.reports.gap.saved import Made

ROOM = 1.0
"""Points by which boxes may meet: lines that follow each other closely, an index below its letter."""
ITALIC = "\U0001d400"
"""From here on letters are those of formulas, below whose slope an index may stand."""
LONGEST = sorted(EFFECTS, key=len, reverse=True)[:8]
PLACE = "2026-11-05_proving_ground_north_double_lane_change_wet_tyres_third_try_after_lunch_repeated"
UNBROKEN = "W" * 120


def worst(recording):
    """A diagnosis whose effects, recordings, parameters and doubts have the longest names."""
    ranking = tuple(
        replace(DELAY, effect=name, probability=0.9 - 0.1 * k, indistinguishable_from=tuple(LONGEST[-3:]))
        for k, name in enumerate(LONGEST)
    )
    recordings = (recording, f"{recording}_2")
    whole = long_names()
    return replace(
        clear(ranking=ranking, applied=tuple(LONGEST[:4]), recordings=recordings, gap=closure(recordings)),
        held_out=closure((f"{recording}_3",)),
        moved=tuple(replace(one, name="longitudinal_load_transfer") for one in whole.moved),
        doubts=(f"{recording}: a_y is 18 ms later than yaw_rate v_x says.",),
    )


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


@pytest.mark.parametrize("recording", [PLACE, UNBROKEN], ids=["many words", "one word"])
def test_no_words_of_a_gaps_pdf_overlap_nor_leave_the_page(recording, tmp_path):
    data = (DataRecord("train", recording, f"{recording}.csv", "a3" * 32, "canonical", 3000, 1, 60.0),)
    made = Made(recording, f"greybox gap {recording}.csv --vehicle {recording}.toml", 0, "0.1.0", data)
    path = write_report(worst(recording), made, tmp_path / "gap.pdf")
    with pdfium.PdfDocument(path) as pdf:
        assert sum(len(lines(page)) for page in pdf) > 200
        assert [trouble for page in pdf for trouble in troubles(page)] == []
