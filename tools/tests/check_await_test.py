"""The await check bites where g++ 12 goes wrong, and only there."""

import sys
import unittest
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))
from check_await import check_text  # noqa: E402

BAD = {
    "an aggregate as argument": "co_await f(Agg{s, 1});",
    "a bare list as argument": "co_await f({s, 1});",
    "designated initialisers": "co_await f(Agg{.name = s});",
    "braces beside the await": "g(Agg{s}, co_await f());",
    "the await inside the braces": "Agg x{a, co_await f()};",
    "one awaited member": "S s{co_await f()};",
    "an initialiser with =": "S s = {co_await f(), 1};",
    "returned in braces": "co_return S{co_await f()};",
    "braces of a template": "co_await f(std::vector<std::string>{a, b});",
    "a capture by value": "co_await call([s] { use(s); });",
    "a copying default": "co_await call([=]() { use(s); });",
    "a capture with a name of its own": "co_await call([t = std::move(s)]() -> int { return 1; });",
    "one of two captures": "co_await call([&a, b](int x) mutable { use(a, b); });",
    "over several lines": "co_await f(\n    1,\n    Agg{s});",
    "in a condition": "if (co_await f(Agg{s})) { use(); }",
    "in the head of a loop": "for (auto& x : co_await f({s})) { use(x); }",
    "behind a block": "if (a) { b(); } co_await f(Agg{s});",
    "inside a lambda's body": "spawn([&]() -> awaitable<void> { co_await f(Agg{s}); });",
    "in a conditional expression": "auto x = a ? co_await f() : Agg{s};",
}
GOOD = {
    "a plain call": "co_await f(s);",
    "a name first": "Agg a{s}; co_await f(std::move(a));",
    "a name in the statement before": "auto a = Agg{s};\nauto b = co_await f(std::move(a));",
    "a class with a constructor": "co_await f(std::string(s));",
    "captures by reference": "co_await call([&] { use(s); });",
    "a named reference": "co_await call([&s](int x) { use(s, x); });",
    "this": "co_await call([this] { use(); });",
    "braces inside a lambda's body": "co_await call([&] { Agg a{s}; use(a); });",
    "a body behind the condition": "if (auto r = co_await f(); r) { Agg a{s}; }",
    "an else behind it": "if (co_await f()) { a(); } else { Agg b{s}; }",
    "a loop over it": "for (auto& x : co_await f()) { Agg a{x}; }",
    "a structured binding": "auto [a, b] = co_await f();",
    "an index": "co_await f(a[i], b[j[0]]);",
    "a capture outside the coroutine": "spawn([s]() -> awaitable<void> { co_await f(); });",
    "a lambda with a result type": "spawn([s]() -> expected<void, Error> { co_await f(); });",
    "a brace in a text": 'co_await f("{}", a);',
    "an await in a comment": "f(Agg{s}); // not co_await\n",
    "one that says why": "co_await f(Pod{1}); // await-ok: trivially destructible",
    "an attribute": "[[maybe_unused]] auto x = co_await f();",
    "a local struct": "struct S { int a{1}; }; co_await f();",
    "a case": "switch (a) { case 1: { co_await f(); break; } default: { Agg b{s}; } }",
    "a raw text": 'co_await f(R"({"a":1})");',
}


class AwaitRule(unittest.TestCase):
    @staticmethod
    def in_function(body):
        return "namespace n {\nawaitable<void> run(Agg s) {\n" + body + "\n}\n}\n"

    def test_what_goes_wrong_is_found(self):
        for name, body in BAD.items():
            with self.subTest(name):
                self.assertEqual(len(check_text(self.in_function(body))), 1)

    def test_what_is_right_passes(self):
        for name, body in GOOD.items():
            with self.subTest(name):
                self.assertEqual(check_text(self.in_function(body)), [])

    def test_the_line_is_that_of_the_braces(self):
        ((line, _),) = check_text(self.in_function("co_await f(\n    1,\n    Agg{s});"))
        self.assertEqual(line, 5)

    def test_a_file_that_ends_too_early_is_no_crash(self):
        whole = self.in_function(" ".join({**BAD, **GOOD}.values()))
        for end in range(0, len(whole), 7):
            check_text(whole[:end])


if __name__ == "__main__":
    unittest.main()
