"""What stands in a report: its tables, and what is below a heading."""

from greybox_id.reports.document import Section, Table, Together


def flat(parts):
    """Every part, those that no page break divides one by one."""
    for part in parts:
        if isinstance(part, Together):
            yield from flat(part.parts)
        else:
            yield part


def tables(document):
    """All tables, in order."""
    return [part for part in flat(document.parts) if isinstance(part, Table)]


def below(document, title):
    """The parts between a heading and the next."""
    found = None
    for part in flat(document.parts):
        if isinstance(part, Section):
            if found is not None:
                break
            found = [] if part.title == title else None
        elif found is not None:
            found.append(part)
    return found or []
