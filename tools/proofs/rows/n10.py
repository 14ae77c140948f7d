"""N10: two devices under one name, two sections with one address."""

import concurrent.futures
import importlib
import os

from ..processes import built

TITLE = "two devices under one name; one name or one address in two sections"
PASS = ("devices that dial in under one name are one reader: the newest connection wins, nothing acknowledged is lost, nothing gets "
        "under another name, others are not touched; a name or a dialled address in two sections is refused with both lines")


def options(parser):
    parser.add_argument("--frames", type=int, help="of each device (default 1000, quick 50)")


def refusals(proof, e2e):
    section = '[[reader]]\nname = "{}"\naddress = "{}"\n'
    for what, first, second, words in (
            ("one name", ("a", "caen://127.0.0.1:1"), ("a", "caen://127.0.0.1:2"), ("already defined", "line")),
            ("one address", ("a", "caen://127.0.0.1:1"), ("b", "caen://127.0.0.1:1"), ("is taken by the reader at line",)),
            ("one line", ("a", "dagprog:///dev/ttyS9"), ("b", "dagprog:///dev/ttyS9"), ("is taken by the reader at line",))):
        gateway = e2e.Gateway(section.format(*first) + section.format(*second))
        done = e2e.run("config", "check", gateway.write_config())
        gateway.dispose()
        said = done.out + done.err
        proof.must(f"two sections with {what}", done.code == 1 and all(word in said for word in words),
                   "refused" if done.code == 1 else "taken")


def bite(gateway, reader):
    """Acknowledged before it is stored, and killed at once."""
    for _ in range(10):
        reader.insist(1)
        gateway.kill_and_restart()


def run(proof):
    os.environ["GANTRY_BINARY"] = built("gantry", proof.options.build)
    import gantry_e2e as e2e
    importlib.reload(e2e)  # the environment names the binary when it is loaded
    import reader_ledger

    refusals(proof, e2e)
    frames = proof.options.frames or (50 if proof.options.quick else 1000)
    gateway = e2e.Gateway(e2e.READER + e2e.EVERY_READ,
                          env={"GANTRY_FAILPOINT": "ack_before_commit,slow_commit"} if proof.options.bite else None).start()
    try:
        books = reader_ledger.Books()
        # Two that take the place from each other, and one that has its own.
        readers = [reader_ledger.NumberedReader(books, index, gateway.port, name=name)
                   for index, name in ((1, "gate-1"), (2, "gate-1"), (3, "gate-2"))]
        if proof.options.bite:
            bite(gateway, readers[2])
        else:
            with concurrent.futures.ThreadPoolExecutor(max_workers=len(readers)) as pool:
                list(pool.map(lambda reader: reader.insist(frames), readers))
        balance = books.balance(gateway.store())
        taken = [row["reason"] for row in gateway.events("reader.disconnected", reader="gate-1")]
        proof.figure("reads acknowledged", balance.acknowledged)
        proof.figure("places taken by a newer connection", taken.count("a newer connection took its place"))
        proof.must_be_zero("acknowledged reads lost", balance.lost, loss=True)
        proof.must_be_zero("invented", balance.invented)
        proof.must_be_zero("under another reader's name", balance.mixed)
        proof.figure("sent again by a device that was displaced, and kept twice", balance.doubled)
        proof.must_be_zero("disconnections of the reader beside them", len(gateway.events("reader.disconnected", reader="gate-2")))
        for reader in readers:
            reader.close()
    finally:
        gateway.dispose()
