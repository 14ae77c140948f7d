"""What the checks share: C++ source with its comments and texts blanked, so that a search finds code only."""

import re

_TOKEN = re.compile(
    r'(?P<comment>//(?:[^\n\\]|\\.)*|/\*.*?\*/)'
    r'|(?P<raw>(?:u8|[uUL])?R"(?P<mark>[^()\\\s]{0,16})\(.*?\)(?P=mark)")'
    r'|(?P<text>"(?:[^"\\\n]|\\.)*")'
    r"|(?P<char>(?<![0-9A-Za-z_])'(?:[^'\\\n]|\\.)*')",
    re.DOTALL,
)


def _spaces(text):
    return re.sub(r"[^\n]", " ", text)


def blank(source, texts=True):
    """`source` with every comment, and with `texts` the inside of every literal, replaced by blanks. Line and
    column of what is left do not change. An #include keeps its path."""

    def replace(match):
        whole = match.group(0)
        if match.group("comment") is not None:
            return _spaces(whole)
        line_start = source.rfind("\n", 0, match.start()) + 1
        if not texts or source[line_start : match.start()].lstrip().startswith("#"):
            return whole
        first, last = whole.index('"' if '"' in whole else "'"), len(whole) - 1
        return whole[: first + 1] + _spaces(whole[first + 1 : last]) + whole[last]

    return _TOKEN.sub(replace, source)


def line_of(source, at):
    return source.count("\n", 0, at) + 1
