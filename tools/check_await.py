#!/usr/bin/env python3
"""Name it, then await it.

g++ 12 destroys twice what a braced initialiser, or a lambda that captures by value, makes in the same expression
as co_await. So such an expression may hold neither; the value gets a name on the line before and is moved in.
A line with `await-ok: <reason>` in a comment is let pass.

Usage: check_await.py FOLDER...; prints one line a fault and exits 1 if there is one."""

import re
import sys
from pathlib import Path

from cpp_text import blank, line_of

TOKEN = re.compile(r"[A-Za-z_]\w*|\d[\w.']*|\"[^\"]*\"|'[^']*'|::|->|&&|\|\||\[\[|\]\]|[^\s\w]")
PAIRS = {"(": ")", "[": "]", "{": "}", "[[": "]]"}
# A brace behind one of these opens a block of statements.
BLOCK_AFTER = {")", "]", ";", "}", ":", "else", "do", "try", "mutable", "noexcept", "const", "override", "final", "&&"}
TYPE_WORDS = {"struct", "class", "union", "enum", "namespace", "extern", "concept"}


class Source:
    """The tokens of a file, which brackets belong together, and which braces hold statements."""

    def __init__(self, text):
        self.text = text
        self.tokens = [(m.group(0), m.start()) for m in TOKEN.finditer(re.sub(r"(?m)^[ \t]*#.*$", "", blank(text)))]
        self.words = [word for word, _ in self.tokens]
        self.partner = {}
        self.inside = [None] * len(self.words)  # the bracket around each token
        open_ = []
        for i, word in enumerate(self.words):
            if word == "]]" and open_ and self.words[open_[-1]] != "[[":
                continue  # a[b[i]]: taken as two below
            if word in PAIRS.values() and open_ and PAIRS[self.words[open_[-1]]] == word:
                self.partner[i] = open_[-1]
                self.partner[open_.pop()] = i
            self.inside[i] = open_[-1] if open_ else None
            if word in PAIRS:
                open_.append(i)
        self.block = {i: self.is_block(i) for i, word in enumerate(self.words) if word == "{"}

    def is_block(self, at):
        if at == 0:
            return True
        before = self.words[at - 1]
        if before in BLOCK_AFTER:
            return True
        if before == "{":
            return self.is_block(at - 1)
        if not (re.match(r"[A-Za-z_]", before) or before in {">", '"', "*", "&"} or before.startswith('"')):
            return False  # behind =, a comma, an opening bracket, an operator
        if before in {"return", "co_return", "co_await", "co_yield"}:
            return False
        # A name: of a type that is defined here, of a lambda's result, or of the type of a value.
        angles = 0
        for i in range(at - 1, -1, -1):
            word = self.words[i]
            if word == ">":
                angles += 1
            elif word == "<":
                angles -= 1
            elif word in TYPE_WORDS:
                return True
            elif word == "->":
                return i > 0 and self.words[i - 1] in {")", "]", "mutable", "noexcept"}
            elif word in {";", "{", "}", "(", "="} or (word == "," and angles <= 0):
                return False
        return False

    def expression(self, at):
        """The first and the last token of the whole expression around a token."""
        first = last = at
        while True:
            first, last = self.widen(first, last)
            around = self.inside[first]
            if around is None or self.block.get(around, False):
                return first, last
            first, last = around, self.partner.get(around, len(self.words) - 1)

    def widen(self, first, last):
        """To both sides, as far as neither a semicolon nor a block ends it."""
        around = self.inside[first]
        while first > 0 and first - 1 != around:
            i = first - 1
            if self.words[i] == ";" or (self.words[i] == "}" and self.block.get(self.partner.get(i), True)):
                break
            first = self.partner.get(i, i) if self.words[i] in PAIRS.values() else i
        end = self.partner.get(around, len(self.words)) if around is not None else len(self.words)
        while last + 1 < end:
            i = last + 1
            if self.words[i] == ";":
                break
            if self.words[i] == "{" and self.block[i] and not self.is_lambda_body(i):
                break
            last = self.partner.get(i, i) if self.words[i] in PAIRS else i
        return first, last

    def is_lambda_body(self, brace):
        """Back over result, specifiers and parameters: is there a capture list?"""
        i = brace - 1
        while i >= 0 and self.words[i] not in {")", "]", ";", "{", "}"}:
            i -= 1
        if i >= 0 and self.words[i] == ")" and i in self.partner:
            i = self.partner[i] - 1
        return i >= 0 and self.words[i] == "]" and i in self.partner and self.is_capture_list(self.partner[i])

    def is_capture_list(self, bracket):
        before = self.words[bracket - 1] if bracket > 0 else ";"
        is_value = re.match(r"[A-Za-z_]|\d", before) and before not in {"return", "co_return", "co_await", "co_yield"}
        return not is_value and before not in {")", "]"}

    def captures_by_value(self, bracket):
        part, parts = [], []
        for i in range(bracket + 1, self.partner.get(bracket, bracket + 1)):
            if self.words[i] == "," and self.inside[i] == bracket:
                parts.append(part)
                part = []
            else:
                part.append(self.words[i])
        parts.append(part)
        return any(part and part[0] != "&" and part != ["this"] for part in parts)

    def faults(self):
        lines = self.text.split("\n")
        seen = set()
        for at, word in enumerate(self.words):
            if word != "co_await":
                continue
            first, last = self.expression(at)
            i = first
            while i <= last:
                what = None
                if self.words[i] == "{":
                    if self.block[i]:
                        i = self.partner.get(i, i) + 1  # a lambda's body: its statements stand for themselves
                        continue
                    what = "braces"
                elif self.words[i] == "[" and self.is_capture_list(i) and self.captures_by_value(i):
                    what = "a capture by value"
                line = line_of(self.text, self.tokens[i][1])
                if what and i not in seen and "await-ok:" not in lines[line - 1]:
                    seen.add(i)
                    yield line, f"{what} in one expression with co_await: name the value on the line before"
                i += 1


def check_text(text):
    return list(Source(text).faults())


def main(arguments):
    if len(arguments) < 2:
        print(__doc__, file=sys.stderr)
        return 2
    found = files = 0
    for folder in arguments[1:]:
        for path in sorted(Path(folder).rglob("*.[ch]pp")):
            text = path.read_text(encoding="utf-8")
            files += 1
            if "co_await" not in text:
                continue
            for line, what in check_text(text):
                print(f"{path}:{line}: {what}")
                found += 1
    if not found:
        print(f"{files} files: what is awaited has its name first")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv))
