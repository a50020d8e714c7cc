"""A diagnosis of the worst names, as a PDF: no words lie over others, none leave the page, in the PDF's own boxes."""

from dataclasses import replace

import pypdfium2 as pdfium
import pytest
from made_gaps import DELAY, clear, closure, long_names
from pdf_boxes import lines, troubles

from greybox_id.fitting.provenance import DataRecord
from greybox_id.models.effects import EFFECTS
from greybox_id.reports.gap.report import write_report
from greybox_id.reports.gap.saved import Made

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


@pytest.mark.parametrize("recording", [PLACE, UNBROKEN], ids=["many words", "one word"])
def test_no_words_of_a_gaps_pdf_overlap_nor_leave_the_page(recording, tmp_path):
    data = (DataRecord("train", recording, f"{recording}.csv", "a3" * 32, "canonical", 3000, 1, 60.0),)
    made = Made(recording, f"greybox gap {recording}.csv --vehicle {recording}.toml", 0, "0.1.0", data)
    path = write_report(worst(recording), made, tmp_path / "gap.pdf")
    with pdfium.PdfDocument(path) as pdf:
        assert sum(len(lines(page)) for page in pdf) > 200
        assert [trouble for page in pdf for trouble in troubles(page)] == []
