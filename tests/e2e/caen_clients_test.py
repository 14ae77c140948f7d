"""The virtual CAEN reader, used by programs that are as strict as the public ones."""

import itertools
import termios
import unittest

from caen_clients import Libcaenrfid, LightLibrary, RustCodec, SerialLibrary
from caen_reader import FAR, LONG_ID, SHORT, TID_OF_SHORT, USER, CaenReader
from caen_wire import COMPACT, CONTINUOUS, FRAMED, PC, RSSI, TID, XPC, At, Broken, Do, Refused, Tty, pair
from gantry_e2e import wait_for

RESERVED_BANK, EPC_BANK, TID_BANK, USER_BANK = 0, 1, 2, 3
STREAM = FRAMED | CONTINUOUS
SAYS = [RSSI, COMPACT, TID, XPC, PC]  # what an inventory can be asked to say
ID = bytes.fromhex(SHORT)
LONG_BYTES = bytes.fromhex(LONG_ID)
SECRET, KILL_SECRET = 0x11223344, 0x55667788


class Programs(CaenReader):
    def refused(self, code, call, *arguments, **more):
        with self.assertRaises(Refused) as trouble:
            call(*arguments, **more)
        self.assertEqual(code, trouble.exception.code)

    def assert_tags(self, tags, flags):
        """The two tags of Source_0, saying what the flags ask for and nothing else."""
        self.assertEqual({SHORT, LONG_ID}, {tag.epc for tag in tags})
        for tag in tags:
            where = ("", "", -1) if flags & COMPACT else ("Source_0", "Ant0", 3)
            self.assertEqual(where, (tag.source, tag.read_point, tag.type))
            if not flags & COMPACT:
                self.assertLess(tag.time[1], 1_000_000)
            mean = -500 if tag.epc == SHORT else -450  # tenths of dBm at the power that the reader has by default
            self.assertAlmostEqual(mean if flags & RSSI else 0, tag.rssi or 0, delta=20)
            self.assertEqual(flags & TID, 0 if tag.tid is None else TID)
            if flags & TID:
                self.assertEqual(TID_OF_SHORT if tag.epc == SHORT else "E2003412", tag.tid)
            self.assertEqual(b"\0\0\0\0" if flags & XPC else None, tag.xpc)
            # Length in words, and the bit of user memory that holds something.
            self.assertEqual((b"\x34\0" if tag.epc == SHORT else b"\x54\0") if flags & PC else None, tag.pc)


class TheLightLibrary(Programs):
    def program(self, *arguments, **more):
        return LightLibrary(self.wire(*arguments, **more))

    def test_learns_model_serial_number_and_firmware(self):
        program = self.program("--set", "model=R4300P", "--set", "serial=0000123")
        self.assertEqual(("R4300P", "0000123"), program.info())
        self.assertEqual("4.1.0", program.call(Do.GET_FIRMWARE, out=[At.FIRMWARE]))

    def test_sets_power_within_the_limits_of_the_reader(self):
        program = self.program()
        get = lambda: program.call(Do.GET_POWER, out=[At.POWER_GET])
        self.assertEqual(500, get())
        program.call(Do.SET_POWER, pair(At.POWER_SET, 1000))
        self.assertEqual(1000, get())
        self.refused(183, program.call, Do.SET_POWER, pair(At.POWER_SET, 2001))
        self.assertEqual(1000, get())

    def test_finds_only_tags_of_the_protocol_that_it_set(self):
        program = self.program()
        self.assertEqual(3, program.call(Do.GET_PROTOCOL, out=[At.PROTOCOL]))
        program.call(Do.SET_PROTOCOL, pair(At.PROTOCOL, 0))
        self.assertEqual((0, []), (program.call(Do.GET_PROTOCOL, out=[At.PROTOCOL]), program.inventory()))
        self.refused(115, program.call, Do.SET_PROTOCOL, pair(At.PROTOCOL, 77))
        program.call(Do.SET_PROTOCOL, pair(At.PROTOCOL, 3))
        self.assert_tags(program.inventory(), 0)

    def test_configures_sources(self):
        program = self.program()
        for parameter in (0, 1, 2, 3, 4, 5, 6, 7, 8, 10, 13, 15):
            which = pair(At.SOURCE, "Source_1"), pair(At.CONFIG, parameter)
            program.call(Do.SET_CONFIG, *which, pair(At.CONFIG_VALUE, 1))
            self.assertEqual(1, program.call(Do.GET_CONFIG, *which, out=[At.CONFIG_VALUE]))
        q = pair(At.CONFIG, 3)
        self.refused(128, program.call, Do.SET_CONFIG, pair(At.SOURCE, "Source_1"), q, pair(At.CONFIG_VALUE, 16))
        self.refused(120, program.call, Do.GET_CONFIG, pair(At.SOURCE, "Source_9"), q, out=[At.CONFIG_VALUE])

    def test_moves_read_points_between_sources_and_asks_how_they_are(self):
        program = self.program()
        ant0, first, second = pair(At.READ_POINT, "Ant0"), pair(At.SOURCE, "Source_0"), pair(At.SOURCE, "Source_1")
        check = lambda source: program.call(Do.CHECK_READ_POINT, ant0, source, out=[At.BOOLEAN])
        self.assertEqual((1, 0), (check(first), check(second)))
        program.call(Do.ADD_READ_POINT, first, ant0)  # it is there: programs do that at their start
        program.call(Do.ADD_READ_POINT, second, ant0)
        program.call(Do.REMOVE_READ_POINT, first, ant0)
        self.assertEqual((0, 1), (check(first), check(second)))
        self.assertEqual({"Ant0", "Ant1"}, {tag.read_point for tag in program.inventory("Source_1")})
        self.refused(123, program.call, Do.ADD_READ_POINT, first, pair(At.READ_POINT, "Ant7"))
        status = lambda: program.call(Do.READ_POINT_STATUS, ant0, out=[At.STATUS])
        for value, word in enumerate(("good", "poor", "bad")):
            self.hand(f"antenna Ant0={word}")
            self.assertEqual(value, status())

    def test_sets_the_radio(self):
        program = self.program()
        for set_it, get_it, kind, value in ((Do.SET_BIT_RATE, Do.GET_BIT_RATE, At.BIT_RATE, 11),
                                            (Do.SET_HOPPING, Do.GET_HOPPING, At.BOOLEAN, 1),
                                            (Do.SET_REGULATION, Do.GET_REGULATION, At.REGULATION, 2),
                                            (Do.SET_RF_CHANNEL, Do.GET_RF_CHANNEL, At.RF_CHANNEL, 7)):
            program.call(set_it, pair(kind, value))
            self.assertEqual(value, program.call(get_it, out=[kind]))
        self.refused(128, program.call, Do.SET_RF_CHANNEL, pair(At.RF_CHANNEL, 10))
        match = pair(At.READ_POINT, "Ant0"), pair(At.CONFIG, 14), pair(At.CONFIG_VALUE, 0)
        self.assertEqual(0x3FA00000, program.call(Do.MATCH_IMPEDANCE, *match, out=[At.VSWR]))  # 1.25

    def test_switches_lines_and_reads_them(self):
        program = self.program()
        get = lambda command: program.call(command, out=[At.IO])
        program.call(Do.SET_IO_DIRECTION, pair(At.IO, 0xF0))
        self.assertEqual(0xF0, get(Do.GET_IO_DIRECTION))
        program.call(Do.SET_IO, pair(At.IO, 0xAF))  # inputs stay what they are
        self.assertEqual(0xA0, get(Do.GET_IO))
        self.hand("input 2=1")
        self.assertEqual(0xA2, get(Do.GET_IO))

    def test_sets_the_serial_line(self):
        program = self.program()
        line = lambda baud: [pair(At.BAUD, baud), pair(At.DATA_BITS, 8), pair(At.STOP_BITS, 1), pair(At.PARITY, 0),
                             pair(At.FLOW, 0)]
        program.call(Do.SET_RS232, *line(921600))
        self.assertIn("921600 8 1", self.state()["serial_line"])
        self.refused(128, program.call, Do.SET_RS232, *line(12345))

    def test_takes_inventories_with_every_combination_of_flags(self):
        program = self.program()
        for size in range(len(SAYS) + 1):
            for flags in map(sum, itertools.combinations(SAYS, size)):
                with self.subTest(flags=hex(flags)):
                    self.assert_tags(program.inventory("Source_0", flags), flags)

    def test_takes_streams_with_every_combination_of_flags(self):
        program = self.program()  # ReadCycle is 1: the stream ends by itself
        for size in range(len(SAYS) + 1):
            for flags in map(sum, itertools.combinations(SAYS, size)):
                with self.subTest(flags=hex(flags)):
                    program.start_stream("Source_0", STREAM | flags)
                    tags, result = program.drain()
                    self.assertEqual((2, 0), (len(tags), result))
                    self.assert_tags(tags, flags)

    def test_reads_until_it_aborts(self):
        program = self.program()
        program.call(Do.SET_CONFIG, pair(At.SOURCE, "Source_0"), pair(At.CONFIG, 0), pair(At.CONFIG_VALUE, 0))
        program.start_stream("Source_0", STREAM | RSSI)
        wait_for(lambda: isinstance(tag := program.next_of_stream(), tuple) and tag.epc == SHORT, "a tag")
        wait_for(lambda: self.state()["tags_sent"] > 20, "it goes on")
        program.abort()
        tags, result = program.drain()
        self.assertEqual(0, result)
        self.assertGreater(len(tags), 10)
        self.assertFalse(program.wire.waits(0.1), "nothing follows the result code")
        self.assertEqual("all", program.info()[0])

    def test_a_stream_of_so_many_rounds_ends_by_itself_and_a_late_abort_does_no_harm(self):
        program = self.program()
        program.call(Do.SET_CONFIG, pair(At.SOURCE, "Source_0"), pair(At.CONFIG, 0), pair(At.CONFIG_VALUE, 3))
        program.start_stream()
        tags, result = program.drain()
        self.assertEqual(0, result)
        self.assertEqual({SHORT, LONG_ID}, {tag.epc for tag in tags})
        program.abort()
        self.assertEqual("all", program.info()[0])
        self.assertFalse(program.wire.waits(0.1))

    def test_a_stream_without_tags_is_silent_until_it_ends(self):
        program = self.program("--set", "round=1s")
        program.start_stream("Source_3")
        self.assertIsNone(program.next_of_stream())
        self.assertEqual(([], 0), program.drain())

    def test_finds_nothing_where_nothing_is(self):
        self.assertEqual([], self.program().inventory("Source_3", RSSI | TID))

    def test_the_longest_ids_and_tids_fit_into_its_buffers(self):
        longest, tid = "AB" * 62, "E2" * 62
        program = self.program(tags=f"epc,tid\n{longest},{tid}\n")
        program.call(Do.SET_CONFIG, pair(At.SOURCE, "Source_0"), pair(At.CONFIG, 13), pair(At.CONFIG_VALUE, 62))
        flags = RSSI | TID | XPC | PC
        self.assertEqual([(longest, tid)], [(tag.epc, tag.tid) for tag in program.inventory("Source_0", flags)])
        program.start_stream("Source_0", STREAM | flags)
        self.assertEqual([(longest, tid)], [(tag.epc, tag.tid) for tag in program.drain()[0]])

    def test_finds_a_crowd_of_tags(self):
        crowd = [f"3074257BF7194E4000{i:06X}" for i in range(300)]
        program = self.program(tags="\n".join(["epc", *crowd]))
        self.assertEqual(sorted(crowd), sorted(tag.epc for tag in program.inventory("Source_0", RSSI)))
        program.start_stream("Source_0", STREAM | RSSI)
        self.assertEqual(sorted(crowd), sorted(tag.epc for tag in program.drain()[0]))

    def test_masks_choose_tags(self):
        program = self.program()
        chosen = lambda *mask: {tag.epc for tag in program.inventory("Source_0", RSSI, mask)}
        self.assertEqual({SHORT}, chosen(EPC_BANK, 32, 16, ID[:2]))
        self.assertEqual({LONG_ID}, chosen(EPC_BANK, 32, 8, LONG_BYTES[:4]))  # more bytes than its bits need
        self.assertEqual({SHORT}, chosen(TID_BANK, 16, 12, bytes.fromhex("1160")))
        self.assertEqual(set(), chosen(EPC_BANK, 32, 16, b"\xFF\xFF"))

    def test_an_unknown_source_is_refused_with_and_without_a_stream(self):
        program = self.program()
        self.refused(120, program.inventory, "Source_9")
        self.refused(120, program.start_stream, "Source_9")
        self.assert_tags(program.inventory(), 0)

    def test_reads_and_writes_memory_by_the_byte_addresses_of_the_manual(self):
        program = self.program()
        read = lambda *where: program.read("Source_0", ID, *where).hex().upper()
        self.assertEqual(USER[4:12], read(USER_BANK, 2, 4))
        self.assertEqual("3400" + SHORT, read(EPC_BANK, 2, 14))
        self.assertEqual(TID_OF_SHORT, read(TID_BANK, 0, 12))
        program.write("Source_0", ID, USER_BANK, 4, b"\xDE\xAD\xBE\xEF")
        self.assertEqual("2233DEADBEEF8899", read(USER_BANK, 2, 8))

    def test_is_told_why_memory_cannot_be_had(self):
        program = self.program()
        self.refused(202, program.read, "Source_0", bytes(12), USER_BANK, 0, 2)
        self.refused(202, program.read, "Source_3", ID, USER_BANK, 0, 2)
        self.refused(205, program.read, "Source_0", ID, USER_BANK, 16, 2)
        self.refused(205, program.write, "Source_0", ID, USER_BANK, 16, b"\0\0")
        self.refused(200, program.read, "Source_0", ID, USER_BANK, 0, 3)
        self.refused(120, program.write, "Nowhere", ID, USER_BANK, 0, b"\0\0")

    def test_locks_memory_behind_a_password(self):
        program = self.program()
        read = lambda password=0: program.read("Source_0", LONG_BYTES, RESERVED_BANK, 4, 4, password)
        program.lock("Source_0", LONG_BYTES, 0x0C02 | 0x30000 | 2 << 6, SECRET)  # user memory and access password
        self.refused(209, program.write, "Source_0", LONG_BYTES, USER_BANK, 0, b"\x12\x34")
        program.write("Source_0", LONG_BYTES, USER_BANK, 0, b"\x12\x34", SECRET)
        self.assertEqual(b"\x12\x34\x22\x33", program.read("Source_0", LONG_BYTES, USER_BANK, 0, 4))
        self.refused(209, read)
        self.assertEqual(SECRET, int.from_bytes(read(SECRET), "big"))

    def test_kills_a_tag(self):
        program = self.program()
        self.refused(213, program.kill, "Source_0", LONG_BYTES, SECRET)
        self.assert_tags(program.inventory(), 0)
        program.kill("Source_0", LONG_BYTES, KILL_SECRET)
        self.assertEqual([SHORT], [tag.epc for tag in program.inventory()])
        self.refused(202, program.kill, "Source_0", LONG_BYTES, KILL_SECRET)

    def test_programs_a_new_id(self):
        program = self.program()
        new = bytes.fromhex("300833B2DDD90140AABB")
        program.program("Source_1", new, nsi=0x1AB)
        tag, = program.inventory("Source_1", PC)
        self.assertEqual((new.hex().upper(), "Ant1", b"\x29\xAB"), (tag.epc, tag.read_point, tag.pc))
        self.refused(202, program.program, "Source_3", new)

    def test_sends_a_command_of_a_tag_maker(self):
        program = self.program()
        tag = [pair(At.SOURCE, "Source_0"), pair(At.TAG_ID_LEN, 12), pair(At.TAG_ID, ID)]
        data = [pair(At.SUB_COMMAND, 0xE0), pair(At.LENGTH, 2), pair(At.TAG_VALUE, b"\1\2"), pair(At.LENGTH, 4)]
        self.refused(210, program.call, Do.CUSTOM, *tag, *data, out=[At.TAG_VALUE])
        self.assert_tags(program.inventory(), 0)

    def test_every_model_can_be_used(self):
        for model in ("A928EU", "A829EU", "A528", "A941M", "R1230CB", "A528B", "R1240I", "R1250I", "R3100C", "R4320P"):
            with self.subTest(model=model):
                program = self.program("--set", f"model={model}")
                self.assertEqual(model, program.info()[0])
                self.assertEqual({SHORT, LONG_ID}, {tag.epc for tag in program.inventory("Source_0", RSSI)})
                self.reader.end()


class TheOldLibrary(Programs):
    def program(self, *arguments, **more):
        return Libcaenrfid(self.wire(*arguments, **more))

    def test_its_own_self_test_passes(self):
        program = self.program()
        ant0 = pair(At.READ_POINT, "Ant0")
        source = lambda i: pair(At.SOURCE, f"Source_{i}")
        check = lambda i: program.get(Do.CHECK_READ_POINT, ant0, source(i), out=At.BOOLEAN)
        self.assertEqual(("4.1.0", 1), (program.firmware(), check(0)))
        for old, new in ((0, 1), (1, 0)):
            program.get(Do.REMOVE_READ_POINT, source(old), ant0)
            program.get(Do.ADD_READ_POINT, source(new), ant0)
            self.assertEqual((0, 1), (check(old), check(new)))
        before = program.get(Do.GET_POWER, out=At.POWER_GET)
        for power in (1000, before):
            program.get(Do.SET_POWER, pair(At.POWER_SET, power))
            self.assertEqual(power, program.get(Do.GET_POWER, out=At.POWER_GET))

    def test_takes_inventories_with_and_without_signal_strength(self):
        program = self.program()
        self.assert_tags(program.inventory(), 0)
        tags = program.inventory(flags=RSSI)
        self.assertTrue(all(0xFDF0 <= tag.rssi <= 0xFE60 for tag in tags))  # kept without a sign: -53 to -42 dBm
        self.assertEqual({SHORT, LONG_ID}, {tag.epc for tag in tags})
        self.assert_tags(program.inventory(source=None), 0)
        self.assertEqual([SHORT], [tag.epc for tag in program.inventory(mask=ID)])  # bytes, taken as bits: still the tag
        self.assertEqual([], program.inventory("Source_3"))
        self.refused(120, program.inventory, "Source_9")

    def test_sets_and_gets(self):
        program = self.program()
        for set_it, get_it, kind, value in ((Do.SET_PROTOCOL, Do.GET_PROTOCOL, At.PROTOCOL, 3), (Do.SET_Q, Do.GET_Q, At.Q, 7),
                                            (Do.SET_BIT_RATE, Do.GET_BIT_RATE, At.BIT_RATE, 5),
                                            (Do.SET_REGULATION, Do.GET_REGULATION, At.REGULATION, 1),
                                            (Do.SET_RF_CHANNEL, Do.GET_RF_CHANNEL, At.RF_CHANNEL, 4),
                                            (Do.SET_IO_DIRECTION, Do.GET_IO_DIRECTION, At.IO, 0xF0),
                                            (Do.SET_IO, Do.GET_IO, At.IO, 0x50)):
            program.get(set_it, pair(kind, value))
            self.assertEqual(value, program.get(get_it, out=kind))
        session = pair(At.SOURCE, "Source_0"), pair(At.CONFIG, 4)
        program.get(Do.SET_CONFIG, *session, pair(At.CONFIG_VALUE, 2))
        self.assertEqual(2, program.get(Do.GET_CONFIG, *session, out=At.CONFIG_VALUE))
        self.refused(183, program.get, Do.SET_POWER, pair(At.POWER_SET, 1))

    def test_reads_writes_locks_and_kills_the_tags_of_its_inventory(self):
        program = self.program()
        tags = {tag.epc: tag for tag in program.inventory()}
        self.assertEqual(USER[:8], program.read(tags[SHORT], USER_BANK, 0, 4).hex().upper())
        data = pair(At.BANK, USER_BANK), pair(At.ADDRESS, 0), pair(At.LENGTH, 2), pair(At.TAG_VALUE, b"\xCA\xFE")
        program.on_tag(Do.WRITE, tags[SHORT], *data)
        self.assertEqual(b"\xCA\xFE", program.read(tags[SHORT], USER_BANK, 0, 2))
        program.on_tag(Do.LOCK, tags[LONG_ID], pair(At.PAYLOAD, 0x0C02), password=SECRET)
        self.refused(209, program.on_tag, Do.WRITE, tags[LONG_ID], *data)
        with self.assertRaises(Broken):  # it looks for data before it looks at the code
            program.read(tags[SHORT], USER_BANK, 200, 2)
        self.refused(200, program.on_tag, Do.KILL, tags[LONG_ID])
        program.on_tag(Do.KILL, tags[LONG_ID], password=KILL_SECRET)
        self.assertEqual([SHORT], [tag.epc for tag in program.inventory()])


class TheSerialLibrary(Programs):
    def test_starts_as_its_example_does_and_reads(self):
        program = SerialLibrary(self.wire("--set", "model=R4320P"))
        source = pair(At.SOURCE, "Source_0")
        program.get(Do.SET_PROTOCOL, pair(At.PROTOCOL, 3))
        for parameter, value in ((3, 3), (4, 0)):
            program.get(Do.SET_CONFIG, source, pair(At.CONFIG, parameter), pair(At.CONFIG_VALUE, value))
        program.get(Do.SET_POWER, pair(At.POWER_SET, 500))
        self.assertEqual(b"\0\0\1\xF4", program.get(Do.GET_POWER, out=At.POWER_GET))
        self.assertEqual(b"R4320P 0000001\0", program.get(Do.GET_INFO, out=At.INFO))
        self.assertEqual(b"\0\1", program.get(Do.CHECK_READ_POINT, pair(At.READ_POINT, "Ant0"), source, out=At.BOOLEAN))
        self.assert_tags(program.inventory(), RSSI | TID)
        self.assertEqual([LONG_ID], [tag.epc for tag in program.inventory(mask=LONG_BYTES)])
        self.assertEqual([], program.inventory("Source_3"))
        self.refused(120, program.inventory, "Source_9")

    def test_an_answer_is_cut_where_a_message_can_be_no_longer(self):
        crowd = {f"3074257BF7194E4000{i:06X}" for i in range(900)}
        program = SerialLibrary(self.wire(tags="\n".join(["epc", *crowd])))
        found = [tag.epc for tag in program.inventory()]
        self.assertEqual(len(found), len(set(found)))
        self.assertLess(set(found), crowd)
        self.assertGreater(len(found), 250)
        self.assertEqual(b"\0\0\1\xF4", program.get(Do.GET_POWER, out=At.POWER_GET))

    def test_writes_with_a_password_that_is_bytes(self):
        program = SerialLibrary(self.wire())
        where = (pair(At.SOURCE, "Source_0"), pair(At.TAG_ID_LEN, 12), pair(At.TAG_ID, ID), pair(At.BANK, USER_BANK),
                 pair(At.ADDRESS, 0), pair(At.LENGTH, 2))
        program.get(Do.WRITE, *where, pair(At.TAG_VALUE, b"\x0B\x0C"), pair(At.PASSWORD, b"\0\0\0\0"))
        self.assertEqual(b"\x0B\x0C", program.get(Do.READ, *where, out=At.TAG_VALUE))
        self.refused(202, program.get, Do.READ, pair(At.SOURCE, "Source_1"), *where[1:], out=At.TAG_VALUE)


class OtherPrograms(Programs):
    def test_a_codec_that_wants_every_byte_accounted_for(self):
        codec = RustCodec(self.wire())
        self.assertEqual([(At.COMMAND, b"\0\x9E"), (At.INFO, b"all 0000001\0"), (At.RESULT, b"\0\0")], codec.ask(Do.GET_INFO))
        kinds = [kind for kind, _ in codec.ask(Do.INVENTORY, pair(At.SOURCE, "Source_0"), pair(At.BITMASK, RSSI | TID))]
        tag = [At.SOURCE, At.READ_POINT, At.TIME, At.TAG_TYPE, At.TAG_ID_LEN, At.TAG_ID, At.RSSI, At.LENGTH, At.TAG_VALUE]
        self.assertEqual([At.COMMAND, *tag, *tag, At.RESULT], kinds)
        self.assertEqual([(At.COMMAND, b"\x12\x34"), (At.RESULT, b"\0\x7F")], codec.ask(0x1234))

    def test_literal_frames_and_fixed_places(self):
        wire = self.wire(tags=f"epc,antenna\n{SHORT},1\n{FAR},1\n")
        wire.send(bytes.fromhex("80010042000053580012000000080001009E"))
        self.assertEqual(b"\0\1\0\x42\0\0\x53\x58", wire.take(44)[:8])
        wire.send(bytes.fromhex("8001000000005358002100000008000100130000000F00FB536F757263655F3000"))
        answer = wire.take(18 + 2 * 74 + 8)  # tags of 96 bits take 74 bytes each
        self.assertEqual({SHORT, FAR}, {answer[at + 62:at + 74].hex().upper() for at in (18, 18 + 74)})
        self.assertEqual(bytes.fromhex("0000000800020000"), answer[-8:])
        self.assertEqual(len(answer), int.from_bytes(answer[8:10], "big"))

    def test_whatever_code_the_reader_gives_each_library_passes_it_on(self):
        port = self.listening()
        for library in (LightLibrary, Libcaenrfid, SerialLibrary):
            wire = self.connect(port)
            ask = library(wire).call if library is LightLibrary else library(wire).get
            for code in (102, 201, 215):
                self.hand(f"result {code}")
                self.refused(code, ask, Do.SET_PROTOCOL, pair(At.PROTOCOL, 3))
            ask(Do.SET_PROTOCOL, pair(At.PROTOCOL, 3))


class ASerialLine(Programs):
    def line(self, *arguments, speed=termios.B115200):
        self.path = self.directory() / "ttyCAEN"
        self.emulate(*arguments, place=("--pty", self.path))
        wait_for(lambda: self.path.is_symlink() or not self.reader.running(), lambda: f"a terminal: {self.reader.err.text()}")
        return self.open(speed)

    def open(self, speed=termios.B115200):
        line = Tty(self.path, speed)
        self.addCleanup(line.close)
        return line

    def test_the_same_programs_run_over_a_terminal(self):
        line = self.line()
        program = LightLibrary(line)
        self.assertEqual(("all", "0000001"), program.info())
        self.assert_tags(program.inventory("Source_0", RSSI | TID), RSSI | TID)
        program.call(Do.SET_CONFIG, pair(At.SOURCE, "Source_0"), pair(At.CONFIG, 0), pair(At.CONFIG_VALUE, 0))
        program.start_stream("Source_0", STREAM | RSSI)
        self.assert_tags([wait_for(program.next_of_stream, "a tag") for _ in range(6)], RSSI)
        program.abort()
        self.assertEqual(0, program.drain()[1])
        self.assert_tags(Libcaenrfid(line).inventory(), 0)
        self.assert_tags(SerialLibrary(line).inventory(), RSSI | TID)

    def test_at_the_slowest_and_the_fastest_rate(self):
        for baud, speed in (("9600", termios.B9600), ("921600", termios.B921600)):
            with self.subTest(baud=baud):
                program = LightLibrary(self.line("--baud", baud, speed=speed))
                self.assert_tags(program.inventory("Source_0", RSSI | TID), RSSI | TID)
                self.refused(202, program.read, "Source_0", bytes(12), USER_BANK, 0, 2)
                self.reader.end()

    def test_a_stream_goes_on_while_nobody_has_the_line_open_and_is_aborted_by_the_next_program(self):
        first = LightLibrary(self.line())
        first.call(Do.SET_CONFIG, pair(At.SOURCE, "Source_0"), pair(At.CONFIG, 0), pair(At.CONFIG_VALUE, 0))
        first.start_stream("Source_0", STREAM | RSSI)
        wait_for(first.next_of_stream, "a tag")
        first.wire.close()  # which a reader at a serial line cannot see
        sent = self.state()["tags_sent"]
        wait_for(lambda: self.state()["tags_sent"] > sent, "it goes on")
        second = LightLibrary(self.open())
        second.abort()
        wait_for(lambda: self.state()["inventory"] == "off", "it ends")
        while second.wire.waits(0.2):
            second.wire.forget_input()
        self.assertEqual(("all", "0000001"), second.info())
        self.assertEqual("4.1.0", Libcaenrfid(second.wire).firmware())


if __name__ == "__main__":
    unittest.main()
