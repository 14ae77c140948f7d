"""Small sums: percentiles, slopes, how late events arrive."""

import calendar
import time


def percentile(values, part):
    ranked = sorted(values)
    return ranked[min(len(ranked) - 1, int(len(ranked) * part))] if ranked else float("nan")


def slope(points):
    """Of y over x by least squares."""
    count = len(points)
    if count < 2:
        return 0.0
    mean_x, mean_y = sum(x for x, _ in points) / count, sum(y for _, y in points) / count
    spread = sum((x - mean_x) ** 2 for x, _ in points)
    return sum((x - mean_x) * (y - mean_y) for x, y in points) / spread if spread else 0.0


def seconds(text):
    """Of a time as events have it, since 1970."""
    whole, _, rest = text.rstrip("Z").partition(".")
    return calendar.timegm(time.strptime(whole, "%Y-%m-%dT%H:%M:%S")) + float(f"0.{rest or 0}")


def latencies(site, sink="mqtt", since=0.0, until=float("inf")):
    """Seconds from an event's time to its first arrival, of events of that time."""
    store = site.store()
    times = {ident: seconds(text) for ident, text in store.execute("SELECT id, time FROM events WHERE type = 'tag.read'")}
    store.close()
    seen, out = set(), []
    for ident, arrived in site.sinks[sink].arrivals():
        at = times.get(ident)
        if at is not None and ident not in seen and since <= at < until:
            seen.add(ident)
            out.append(arrived - at)
    return out
