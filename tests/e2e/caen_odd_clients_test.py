"""The virtual CAEN reader, and programs that send unlike others: one id for ever, many requests at once, in pieces, in
another order, aborts out of place. And a host of its notification channels."""

import struct
import unittest

from caen_clients import LightLibrary, NotifyHost, split
from caen_reader import FAR, LONG_ID, SHORT, CaenReader
from caen_wire import ABORT, COMPACT, CONTINUOUS, FRAMED, TID, At, Broken, Do, Refused, message, pair, read_header
from gantry_e2e import wait_for

SOURCE = pair(At.SOURCE, "Source_0")
STREAM = FRAMED | CONTINUOUS
NEW, OBSERVED, LOST = 2, 3, 4  # events


def next_answer(wire):
    """Message id, command, result, and what stands between them."""
    number, length = read_header(wire.take(10))
    (first, command), *between, (last, result) = split(wire.take(length - 10))
    if (first, last) != (At.COMMAND, At.RESULT):
        raise Broken("no answer")
    return number, int.from_bytes(command, "big"), int.from_bytes(result, "big"), between


class MessageIds(CaenReader):
    def test_zero_for_ever(self):
        wire = self.wire()
        for _ in range(100):
            wire.send(message(Do.GET_POWER))
            self.assertEqual((0, Do.GET_POWER, 0, [(At.POWER_GET, b"\0\0\1\xF4")]), next_answer(wire))
        wire.send(message(Do.INVENTORY, SOURCE))
        number, command, result, tags = next_answer(wire)
        self.assertEqual((0, Do.INVENTORY, 0, 2 * 6), (number, command, result, len(tags)))

    def test_a_counter_that_starts_again(self):
        program = LightLibrary(self.wire())
        program.number = 0xFFFE
        for _ in range(4):  # the program itself checks that its id comes back
            self.assertEqual(("all", "0000001"), program.info())

    def test_any_and_the_same_again(self):
        wire = self.wire()
        for number in (0x42, 0xFFFF, 7, 7, 3):
            wire.send(message(Do.SET_PROTOCOL, pair(At.PROTOCOL, 3), number=number))
            self.assertEqual((number, Do.SET_PROTOCOL, 0, []), next_answer(wire))


class Pieces(CaenReader):
    def test_many_requests_in_one_segment_are_answered_in_order(self):
        wire = self.wire("--set", "round=200ms")  # so that what follows an inventory has to wait for it
        commands = [Do.GET_INFO, Do.INVENTORY, Do.GET_POWER, Do.RAW_READ_IDS, 0x1234, Do.INVENTORY, Do.GET_FIRMWARE] * 2
        reads = {Do.INVENTORY, Do.RAW_READ_IDS}
        wire.send(b"".join(message(each, *([SOURCE] if each in reads else []), number=i) for i, each in enumerate(commands)))
        for i, command in enumerate(commands):
            number, answered, result, between = next_answer(wire)
            self.assertEqual((i, command, 127 if command == 0x1234 else 0), (number, answered, result))
            if command in reads:
                self.assertEqual({bytes.fromhex(SHORT), bytes.fromhex(LONG_ID)},
                                 {value for kind, value in between if kind == At.TAG_ID})
        self.assertFalse(wire.waits(0.1))

    def test_requests_that_come_byte_by_byte(self):
        wire = self.wire()
        for byte in message(Do.SET_POWER, pair(At.POWER_SET, 777), number=5) + message(Do.GET_POWER, number=6):
            wire.send(bytes([byte]))
        self.assertEqual((5, Do.SET_POWER, 0, []), next_answer(wire))
        self.assertEqual((6, Do.GET_POWER, 0, [(At.POWER_GET, struct.pack(">I", 777))]), next_answer(wire))

    def test_a_request_cut_at_every_place(self):
        wire = self.wire()
        whole = message(Do.GET_CONFIG, SOURCE, pair(At.CONFIG, 3), number=9)
        for cut in range(1, len(whole)):
            wire.send(whole[:cut])
            wire.send(whole[cut:] + message(Do.GET_Q, number=10))
            self.assertEqual((9, Do.GET_CONFIG, 0), next_answer(wire)[:3])
            self.assertEqual((10, Do.GET_Q, 0), next_answer(wire)[:3])

    def test_requests_behind_the_start_of_a_stream_do_not_disturb_it(self):
        wire = self.wire()
        start = [SOURCE, pair(At.CONFIG, 0), pair(At.CONFIG_VALUE, 0)]
        wire.send(message(Do.SET_CONFIG, *start) + message(Do.INVENTORY, SOURCE, pair(At.BITMASK, STREAM), number=1)
                  + message(Do.GET_POWER, number=2))
        self.assertEqual(0, next_answer(wire)[2])
        self.assertEqual((1, 0), read_header(wire.take(10)))
        self.assertEqual(pair(At.COMMAND, Do.INVENTORY), wire.take(8))
        program = LightLibrary(wire)
        wait_for(lambda: program.next_of_stream(), "a tag")
        wire.send(ABORT)
        self.assertEqual(0, program.drain()[1])
        self.assertEqual(("all", "0000001"), program.info())


class SlowReading(CaenReader):
    def test_loses_tags_but_never_the_place_in_the_stream(self):
        crowd = [f"{i:0124X}" for i in range(2000)]  # the longest ids, so that little of them fills much
        rows = [f"{epc},{'E2' * 62}" for epc in crowd]
        program = LightLibrary(self.wire(tags="\n".join(["epc,tid", *rows])))
        for which, value in ((0, 0), (13, 62)):
            program.call(Do.SET_CONFIG, SOURCE, pair(At.CONFIG, which), pair(At.CONFIG_VALUE, value))
        program.start_stream("Source_0", STREAM | COMPACT | TID)
        wait_for(lambda: self.state()["tags_lost"] > 0, "there is no more room for tags", deadline=90)
        program.abort()
        tags, result = program.drain()  # it would notice the first byte out of place
        self.assertEqual((0, set(crowd)), (result, {tag.epc for tag in tags}))
        self.assertEqual({"E2" * 62}, {tag.tid for tag in tags})
        self.assertEqual(("all", "0000001"), program.info())


class AnotherOrder(CaenReader):
    def shuffled(self, wire):
        """The result of a request whose attributes stand in another order than the manual's."""
        wire.send(message(Do.READ, pair(At.LENGTH, 4), pair(At.ADDRESS, 0), pair(At.BANK, 3), pair(At.TAG_ID, bytes.fromhex(SHORT)),
                          pair(At.TAG_ID_LEN, 12), SOURCE))
        return next_answer(wire)[2:]

    def test_is_refused_unless_the_reader_is_told_to_take_it(self):
        self.assertEqual((200, []), self.shuffled(self.wire()))

    def test_is_taken_by_a_reader_that_was_told_to(self):
        wire = self.wire("--set", "attribute_order=any")
        self.assertEqual((0, [(At.TAG_VALUE, b"\x00\x11\x22\x33")]), self.shuffled(wire))
        wire.send(message(Do.SET_CONFIG, pair(At.CONFIG_VALUE, 5), pair(At.CONFIG, 3), SOURCE))
        self.assertEqual(0, next_answer(wire)[2])
        wire.send(message(Do.GET_CONFIG, pair(At.CONFIG, 3), SOURCE))
        self.assertEqual([(At.CONFIG_VALUE, b"\0\0\0\5")], next_answer(wire)[3])


class WrongRequests(CaenReader):
    def test_attributes_missing_doubled_of_another_size_or_unknown(self):
        wire = self.wire()
        power = pair(At.POWER_SET, 100)
        for pairs in ([], [power, power], [pair(At.POWER_SET, b"\0\x64")], [power, pair(0x4F, b"\0\0")], [pair(At.POWER_GET, 100)]):
            wire.send(message(Do.SET_POWER, *pairs))
            self.assertEqual((0, Do.SET_POWER, 200, []), next_answer(wire))
        wire.send(message(Do.GET_POWER))
        self.assertEqual([(At.POWER_GET, b"\0\0\1\xF4")], next_answer(wire)[3])

    def test_commands_that_no_reader_or_not_this_one_has(self):
        wire = self.wire("--set", "model=R1270")
        for command, code in ((0x71, 127), (0x1234, 127), (Do.ADD_READ_POINT, 206), (Do.ALLOCATE_TRIGGER, 206)):
            wire.send(message(command))
            self.assertEqual((0, command, code, []), next_answer(wire))


class Aborts(CaenReader):
    def test_before_the_first_request(self):
        wire = self.wire()
        wire.send(ABORT)
        self.assertFalse(wire.waits(0.1), "there is nothing to abort, and nothing to say to it")
        wire.send(ABORT * 3 + message(Do.GET_INFO, number=4))
        self.assertEqual((4, Do.GET_INFO, 0), next_answer(wire)[:3])

    def test_in_one_segment_with_the_start(self):
        wire = self.wire()
        wire.send(message(Do.INVENTORY, SOURCE, pair(At.BITMASK, STREAM), number=1) + ABORT + message(Do.GET_INFO, number=2))
        program = LightLibrary(wire)
        self.assertEqual((1, 0), read_header(wire.take(10)))
        self.assertEqual(pair(At.COMMAND, Do.INVENTORY), wire.take(8))
        self.assertEqual(0, program.drain()[1])

    def test_at_the_start_of_programs_that_use_all_antennas(self):
        wire = self.wire()
        wire.send(ABORT)
        setting = lambda which: message(Do.SET_CONFIG, SOURCE, pair(At.CONFIG, which), pair(At.CONFIG_VALUE, 0))
        starts = [message(Do.SET_Q, pair(At.Q, 3)), setting(0), setting(6)]
        starts += [message(Do.ADD_READ_POINT, SOURCE, pair(At.READ_POINT, f"Ant{i}")) for i in range(4)]
        for each in starts:
            wire.send(each)
            self.assertEqual(0, next_answer(wire)[2])
        # A mask of four bytes, of which no bit counts.
        wire.send(message(Do.INVENTORY, SOURCE, pair(At.LENGTH, 0), pair(At.TAG_ID, bytes(4)), pair(At.ADDRESS, 0),
                          pair(At.BITMASK, STREAM)))
        self.assertEqual((0, 0), read_header(wire.take(10)))
        self.assertEqual(pair(At.COMMAND, Do.INVENTORY), wire.take(8))
        program, seen = LightLibrary(wire), set()
        wait_for(lambda: seen.add((tag := program.next_of_stream()) and (tag.epc, tag.read_point)) or len(seen) == 3, "all tags")
        self.assertEqual({(SHORT, "Ant0"), (LONG_ID, "Ant0"), (FAR, "Ant1")}, seen)

    def test_from_a_program_that_goes_away_instead(self):
        port = self.listening()
        first = LightLibrary(self.connect(port))
        first.call(Do.SET_CONFIG, SOURCE, pair(At.CONFIG, 0), pair(At.CONFIG_VALUE, 0))
        first.start_stream()
        wait_for(first.next_of_stream, "a tag")
        first.wire.close()
        wait_for(lambda: self.state()["inventory"] == "off", "the stream ends with its connection")
        self.assertEqual(2, len(LightLibrary(self.connect(port)).inventory()))

    def test_a_program_that_left_its_connection_open_does_not_shut_others_out(self):
        port = self.listening()
        first, second = self.connect(port), self.connect(port)
        self.assertEqual("all", LightLibrary(second).info()[0])
        with self.assertRaises((Broken, OSError)):
            first.take(1)


class AHostOfNotifications(CaenReader):
    def setUp(self):
        self.program = LightLibrary(self.wire("--set", "redial=50ms"))
        self.host = NotifyHost()
        self.addCleanup(self.host.close)

    def call(self, command, **names):
        self.program.call(command, *(pair(At[kind.upper()], value) for kind, value in names.items()))

    def refused(self, code, command, **names):
        with self.assertRaises(Refused) as trouble:
            self.call(command, **names)
        self.assertEqual(code, trouble.exception.code)

    def set_up(self, source="Source_0"):
        """In the order of the maker's demo."""
        self.call(Do.ALLOCATE_TRIGGER, trigger="notify", trigger_type="100")
        self.call(Do.ALLOCATE_TRIGGER, trigger="read", trigger_type="TIMED:50")
        self.call(Do.ALLOCATE_CHANNEL, channel="door", channel_address=self.host.address)
        self.call(Do.ADD_SOURCE, source=source, channel="door")
        self.call(Do.ADD_NOTIFY_TRIGGER, channel="door", trigger="notify")
        self.call(Do.ADD_READ_TRIGGER, source=source, trigger="read")
        self.host.accept()

    def tear_down(self, source="Source_0"):
        self.call(Do.REMOVE_READ_TRIGGER, source=source, trigger="read")
        self.call(Do.REMOVE_NOTIFY_TRIGGER, channel="door", trigger="notify")
        self.call(Do.REMOVE_SOURCE, source=source, channel="door")
        self.call(Do.DEALLOCATE_CHANNEL, channel="door")
        for name in ("notify", "read"):
            self.call(Do.DEALLOCATE_TRIGGER, trigger=name)

    def hear(self, *wanted):
        """Reports until these (epc, event) were in them; all that was heard."""
        heard = []
        while not set(wanted) <= {(epc, event) for epc, _, event, _ in heard}:
            heard += self.host.next()
        return heard

    def test_hears_of_tags_and_then_the_end(self):
        self.set_up()
        heard = self.hear((SHORT, NEW), (LONG_ID, NEW), (SHORT, OBSERVED), (LONG_ID, OBSERVED))
        self.assertEqual({"Source_0"}, {source for _, source, _, _ in heard})
        self.assertEqual({SHORT, LONG_ID}, {epc for epc, _, _, _ in heard})
        self.assertEqual(4, len(heard), "what goes on is no news")
        self.tear_down()
        self.assertEqual("kill", self.host.next())
        with self.assertRaises((Broken, OSError)):
            self.host.wire.take(1)

    def test_hears_of_a_tag_that_went(self):
        self.set_up("Source_1")
        self.hear((FAR, OBSERVED))
        self.hand("antenna Ant1=bad")
        self.assertEqual([(FAR, LOST)], [(epc, event) for epc, _, event, _ in self.hear((FAR, LOST))][:1])

    def test_the_command_channel_goes_on_meanwhile(self):
        self.set_up()
        self.assertEqual(("all", "0000001"), self.program.info())
        self.assertEqual(2, len(self.program.inventory()))
        self.hear((SHORT, NEW))

    def test_is_dialled_again_after_it_was_away(self):
        self.set_up()
        self.hear((SHORT, NEW))
        self.host.hang_up()
        self.host.accept()
        self.hand("antenna Ant0=bad")
        self.hear((SHORT, LOST))

    def test_the_end_of_the_command_connection_does_not_end_the_channel(self):
        self.set_up()
        self.program.wire.close()
        self.hear((SHORT, NEW), (LONG_ID, NEW))

    def test_wrong_set_up_is_told_by_its_code(self):
        self.set_up()
        trigger, channel = Do.ALLOCATE_TRIGGER, Do.ALLOCATE_CHANNEL
        for code, command, names in ((111, trigger, {"trigger": "read", "trigger_type": "10"}),
                                     (110, trigger, {"trigger": "t", "trigger_type": "0"}),
                                     (113, trigger, {"trigger": "t", "trigger_type": "moon"}),
                                     (118, trigger, {"trigger": "", "trigger_type": "10"}),
                                     (100, channel, {"channel": "door", "channel_address": "127.0.0.1:9"}),
                                     (101, channel, {"channel": "other", "channel_address": self.host.address}),
                                     (114, channel, {"channel": "other", "channel_address": "moon:1"}),
                                     (116, channel, {"channel": "other", "channel_address": "127.0.0.1:0"}),
                                     (121, Do.ADD_READ_TRIGGER, {"source": "Source_0", "trigger": "none"}),
                                     (122, Do.ADD_SOURCE, {"source": "Source_0", "channel": "none"}),
                                     (120, Do.ADD_SOURCE, {"source": "Source_9", "channel": "door"}),
                                     (109, Do.REMOVE_SOURCE, {"source": "Source_3", "channel": "door"}),
                                     (124, Do.DEALLOCATE_CHANNEL, {"channel": "door"}),
                                     (125, Do.DEALLOCATE_TRIGGER, {"trigger": "read"})):
            with self.subTest(code=code):
                self.refused(code, command, **names)
        self.hear((SHORT, NEW))


if __name__ == "__main__":
    unittest.main()
