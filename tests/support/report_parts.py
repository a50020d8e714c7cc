"""What stands in a report: its tables, and what is below a heading."""

from greybox_id.reports.document import Section, Table


def tables(document):
    """All tables, in order."""
    return [part for part in document.flat if isinstance(part, Table)]


def below(document, title):
    """The parts between a heading and the next."""
    found = None
    for part in document.flat:
        if isinstance(part, Section):
            if found is not None:
                break
            found = [] if part.title == title else None
        elif found is not None:
            found.append(part)
    return found or []
