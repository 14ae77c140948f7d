"""The books: what readers generated and were told is safe, what the store holds, what each sink has received."""

from collections import Counter
from dataclasses import dataclass, field

MAGIC = "1ED6"  # how ids of numbered reads begin; see src/testkit/ledger.cpp


def numbered(tag):
    """Reader and number of a tag id, or nothing."""
    if tag.startswith(MAGIC) and len(tag) == 24:
        return int(tag[4:12], 16), int(tag[12:], 16)
    if tag.startswith("E0") and len(tag) == 16:
        return int(tag[2:6], 16), int(tag[6:], 16)
    return None


@dataclass
class StoreBook:
    events: list = field(default_factory=list)  # (id, reader's name or None, seq), in order
    stored: int = 0      # numbered reads
    lost: int = 0        # acknowledged and not there
    doubled: int = 0     # there more than once, and not marked
    marked: int = 0      # possible_repeat
    invented: int = 0    # there, and no reader made them
    disordered: int = 0  # behind a later one of the same reader, and not marked
    gaps: int = 0        # numbers of events that are missing
    unacknowledged_lost: dict = field(default_factory=dict)  # by kind of reader: (lost, generated)
    per_reader: Counter = field(default_factory=Counter)


def read_store(database, figures):
    book, seen, last, expected = StoreBook(), {}, {}, None
    readers = {each["reader"]: each for each in figures}
    rows = database.execute("SELECT seq, id, type, reader, tag, possible_repeat FROM events ORDER BY seq")
    for seq, ident, kind, name, tag, repeat in rows:
        book.gaps += expected is not None and seq != expected
        expected = seq + 1
        book.events.append((ident, name, seq))
        found = numbered(tag) if kind == "tag.read" and tag else None
        if not found:
            continue
        book.stored += 1
        reader, number = found
        if reader not in readers or not 0 < number <= readers[reader]["generated"]:
            book.invented += 1
            continue
        if repeat:
            book.marked += 1
        elif (reader, number) in seen:
            book.doubled += 1
        elif number < last.get(reader, 0):
            book.disordered += 1
        last[reader] = max(number, last.get(reader, 0))
        if (reader, number) not in seen:
            seen[reader, number] = True
            book.per_reader[reader] += 1
    for each in figures:
        present = book.per_reader[each["reader"]]
        if each["acknowledges"]:
            book.lost += sum((each["reader"], number) not in seen for number in range(1, each["acknowledged"] + 1))
        else:
            kind = each["name"].rsplit("-", 1)[0]
            lost, generated = book.unacknowledged_lost.get(kind, (0, 0))
            book.unacknowledged_lost[kind] = (lost + each["generated"] - present, generated + each["generated"])
    return book


@dataclass
class SinkBook:
    delivered: int = 0   # different ids
    lost: int = 0        # in the store, and not here
    first_lost: str = ""
    doubled: int = 0     # here more than once
    invented: int = 0    # here, and not in the store
    disordered: int = 0  # first copies behind a later event of the same reader


def read_sink(events, ids, up_to, missing_allowed=()):
    """What is stored up to the event `up_to` must be there, later ones may. `missing_allowed`: ids that have become dead
    letters; such as were offered again may come late."""
    place = {ident: (number, reader) for number, (ident, reader, _) in enumerate(events)}
    counts, last, book = Counter(ids), {}, SinkBook()
    excused = set(missing_allowed)
    for ident in dict.fromkeys(ids):
        if ident not in place:
            book.invented += 1
            continue
        number, reader = place[ident]
        if ident not in excused:
            book.disordered += number < last.get(reader, -1)
            last[reader] = max(number, last.get(reader, -1))
    book.delivered = sum(ident in place for ident in counts)
    lost = [ident for ident, _, seq in events if seq <= up_to and ident not in counts and ident not in excused]
    book.lost, book.first_lost = len(lost), next(iter(lost), "")
    book.doubled = sum(count - 1 for count in counts.values())
    return book


def check(proof, site, figures, doubles_allowed=True, excused=None):
    """Compares all books, prints them, and says to `proof` what is wrong. The store's book."""
    with_store = site.store()
    book = read_store(with_store, figures)
    with_store.close()
    generated = sum(each["generated"] for each in figures)
    acknowledged = sum(each["acknowledged"] for each in figures if each["acknowledges"])
    proof.figure("generated", generated, "reads")
    proof.figure("acknowledged", acknowledged, "reads")
    proof.figure("stored", book.stored, "reads")
    proof.figure("dropped_by_full_readers", sum(each["dropped"] for each in figures if each["acknowledges"]), "reads")
    proof.must_be_zero("store: acknowledged reads lost", book.lost, loss=True)
    proof.must_be_zero("store: reads of acknowledging readers never acknowledged",
                       sum(each["generated"] - each["acknowledged"] for each in figures if each["acknowledges"]))
    proof.must_be_zero("store: doubled", book.doubled)
    proof.must_be_zero("store: invented", book.invented)
    proof.must_be_zero("store: out of a reader's order", book.disordered)
    proof.must_be_zero("store: gaps in seq", book.gaps, loss=True)
    proof.figure("store: marked possible_repeat", book.marked, "reads")
    for name, sink in site.sinks.items():
        ids = sink.ids()
        found = read_sink(book.events, ids, site.settled, (excused or {}).get(name, ()))
        proof.figure(f"{name}: delivered", found.delivered, f"of {len(book.events)} events, {site.settled} of them waited for")
        proof.must_be_zero(f"{name}: lost", found.lost, loss=True)
        if found.lost:
            proof.figure(f"{name}: the first that is lost", found.first_lost)
        proof.must_be_zero(f"{name}: invented", found.invented)
        proof.must_be_zero(f"{name}: out of a reader's order", found.disordered)
        if sink.idempotent or not doubles_allowed:
            proof.must_be_zero(f"{name}: doubled ids", found.doubled)
        else:
            proof.figure(f"{name}: doubled ids", found.doubled, "counted; a consumer drops them by id")
    return book
