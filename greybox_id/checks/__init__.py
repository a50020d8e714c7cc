"""Are the data to be trusted? Findings about clock, values, agreement between channels, offsets at rest and delays."""

from __future__ import annotations

from ..recording import Recording
from .consistency import check_consistency
from .delays import check_delays
from .duplicates import check_duplicates
from .finding import Finding, Severity, Where, distrusted
from .pairs import pairs
from .reading import check_reading
from .rest import check_rest
from .time import check_time
from .values import check_values

__all__ = ["Finding", "Severity", "Where", "check", "distrusted"]


def check(recording: Recording, wheelbase: float | None = None) -> list[Finding]:
    """All that is noteworthy or wrong in a recording, gravest first.

    Parameters
    ----------
    recording : signals in SI units, ISO 8855 signs.
    wheelbase : in m, if known: the steering's unit can then be checked more sharply.

    Returns
    -------
    list of Finding
        Empty if nothing is noteworthy. `distrusted(findings)` tells whether the recording can be used as it is.
    """
    findings = [*check_reading(recording), *check_time(recording), *check_values(recording)]
    if recording.sample_time > 0:  # false also where no two rows follow each other
        found = pairs(recording)
        findings += [*check_duplicates(recording), *check_rest(recording)]
        findings += [*check_consistency(recording, found, wheelbase), *check_delays(recording, found)]
    gravest = list(Severity)[::-1]
    return sorted(findings, key=lambda finding: gravest.index(finding.severity))
