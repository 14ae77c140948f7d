"""The layer check bites: a small tree that passes, and each way to spoil it."""

import sys
import tempfile
import unittest
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))
from check_layers import Check, calls  # noqa: E402

TREE = {
    "base/CMakeLists.txt": "gantry_module(base FOREIGN clock tl/expected.hpp)",
    "base/bytes.hpp": "#pragma once\n#include <vector>\n#include <tl/expected.hpp>\n",
    "base/time.cpp": '#include "base/bytes.hpp"\nauto now() { return std::chrono::steady_clock::now(); }\n',
    "event/CMakeLists.txt": "gantry_module(event DEPENDS base TEST_FOREIGN boost/json)",
    "event/event.hpp": '#pragma once\n#include "base/bytes.hpp"\n',
    "event/tests/event_test.cpp": (
        '#include "event/event.hpp"\n#include "testkit/kit.hpp"\n#include "share.hpp"\n#include <boost/json.hpp>\n'
        "#include <gtest/gtest.h>\n#include <thread>\n"
    ),
    "event/tests/share.hpp": "#pragma once\n",
    "testkit/CMakeLists.txt": "gantry_module(testkit DEPENDS base event FOREIGN gtest/)",
    "testkit/kit.hpp": '#pragma once\n#include "event/event.hpp"\n#include <gtest/gtest.h>\n',
    "presence/CMakeLists.txt": "gantry_module(presence DEPENDS base event TEST_DEPENDS link)",
    "presence/presence.cpp": '#include "event/event.hpp"\n// silion readers: see steady_clock::now()\n',
    "presence/tests/presence_test.cpp": '#include "link/link.hpp"\n',
    "link/CMakeLists.txt": "gantry_module(link DEPENDS base\n  FOREIGN boost/ sys/ mutex # of links\n)",
    "link/link.hpp": "#pragma once\n#include <mutex>\n",
    "link/loop_impl.hpp": "#pragma once\n#include <boost/asio.hpp>\n",
    "link/link.cpp": '#include "link/loop_impl.hpp"\n#include <boost/asio.hpp>\n#include <sys/socket.h>\n',
    "protocols/CMakeLists.txt": "gantry_protocol(silion)\ngantry_module(protocols DEPENDS base ${libraries})",
    "protocols/registry.cpp": '#include "base/bytes.hpp"\n',
    "protocols/silion/CMakeLists.txt": "gantry_module(protocols/silion DEPENDS base)",
    "protocols/silion/plugin.hpp": '#pragma once\n#include "base/bytes.hpp"\nint silion();\n',
}

SPOILT = {
    "an include that is not declared": ({"event/a.cpp": '#include "link/link.hpp"\n'}, "does not name link"),
    "a module upwards": (
        {"wire/CMakeLists.txt": "gantry_module(wire DEPENDS link)"},
        "wire (layer 1) DEPENDS link (layer 3)",
    ),
    "a neighbour of the same layer": (
        {"presence/CMakeLists.txt": "gantry_module(presence DEPENDS base event protocols TEST_DEPENDS link)"},
        "presence (layer 2) DEPENDS protocols (layer 2)",
    ),
    "a circle": (
        {
            "wire/CMakeLists.txt": "gantry_module(wire DEPENDS event)",
            "event/CMakeLists.txt": "gantry_module(event DEPENDS base wire TEST_FOREIGN boost/json)",
        },
        "circle: event -> wire -> event",
    ),
    "a module that does not exist": ({"wire/CMakeLists.txt": "gantry_module(wire DEPENDS bass)"}, "is no module"),
    "a module without a layer": ({"util/CMakeLists.txt": "gantry_module(util)"}, "util has no layer"),
    "a folder without a module": ({"stray/a.cpp": "int a;\n"}, "no gantry_module()"),
    "an outside header": ({"event/a.cpp": "#include <boost/json.hpp>\n"}, "<boost/json.hpp> is not in FOREIGN"),
    "a header of threads": ({"event/a.cpp": "#include <thread>\n"}, "<thread> is not in FOREIGN"),
    "a word that begins like a declared one": ({"link/a.cpp": "#include <mutex.h>\n"}, "<mutex.h> is not in"),
    "a heavy header in a header": ({"link/a.hpp": "#include <boost/asio/ip/tcp.hpp>\n"}, "is heavy"),
    "the inside of another module": (
        {"presence/tests/b_test.cpp": '#include "link/loop_impl.hpp"\n'},
        "is for link alone",
    ),
    "a path that is not from src": ({"event/a.cpp": '#include "event.hpp"\n'}, "write the path from src/"),
    "the testkit in code": ({"event/a.cpp": '#include "testkit/kit.hpp"\n'}, "does not name testkit"),
    "the testkit in DEPENDS": (
        {"wire/CMakeLists.txt": "gantry_module(wire DEPENDS testkit)"},
        "is for tests",
    ),
    "a steady clock": ({"event/a.cpp": "auto t = std::chrono::steady_clock::now();\n"}, "event may read no clock"),
    "a clock of its own": ({"event/a.cpp": "auto t = Clock_clock :: now ();\n"}, "event may read no clock"),
    "the old clock": ({"event/a.cpp": "auto t = time(nullptr);\n"}, "event may read no clock"),
    "the system's clock": ({"event/a.cpp": "clock_gettime(0, &t);\n"}, "event may read no clock"),
    "a clock in a test": ({"event/tests/b_test.cpp": "auto t = steady_clock::now();\n"}, "may read no clock"),
    "a make in code": ({"event/a.cpp": "int silion_count;\n"}, '"silion" belongs under protocols/'),
    "a make in a text": ({"event/a.cpp": 'auto t = "CAEN";\n'}, '"CAEN" belongs under protocols/'),
}


class Layers(unittest.TestCase):
    def faults(self, changed=None):
        with tempfile.TemporaryDirectory() as folder:
            src = Path(folder) / "src"
            for name, text in {**TREE, **(changed or {})}.items():
                path = src / name
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_text(text, encoding="utf-8")
            return Check(src).run()

    def test_a_tree_that_keeps_the_rules_passes(self):
        self.assertEqual(self.faults(), [])

    def test_each_broken_rule_is_found_and_nothing_else(self):
        for name, (changed, expected) in SPOILT.items():
            with self.subTest(name):
                faults = self.faults(changed)
                self.assertEqual(len(faults), 1, faults)
                self.assertIn(expected, faults[0])

    def test_comments_and_texts_are_no_code(self):
        quiet = '// #include "link/link.hpp"\n/* steady_clock::now() */\nauto t = "time(0)", r = R"(a::now()_clock::now())";\n'
        self.assertEqual(self.faults({"event/a.cpp": quiet}), [])

    def test_a_wait_time_or_a_member_called_time_is_no_clock(self):
        self.assertEqual(self.faults({"event/a.cpp": "out.time(event.time); x.run_time(0); y->time(0);\n"}), [])

    def test_an_empty_tree_is_a_fault(self):
        with tempfile.TemporaryDirectory() as folder:
            self.assertEqual(len(Check(Path(folder)).run()), 1)

    def test_calls_of_cmake_are_read_over_lines_and_comments(self):
        text = "# gantry_module(no)\ngantry_module(a B # c\n  d)\ngantry_modules(no)\n"
        self.assertEqual(calls(text, "gantry_module"), [["a", "B", "d"]])


if __name__ == "__main__":
    unittest.main()
