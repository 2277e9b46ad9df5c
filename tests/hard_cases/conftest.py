"""`pytest tests/hard_cases -v` ends with the table of what was measured, the bounds and where they come from."""

COLUMNS = ("case", "quantity measured", "measured", "bound", "naive way", "where the bound comes from", "CPU s")


def pytest_terminal_summary(terminalreporter):
    reports = terminalreporter.stats.get("passed", []) + terminalreporter.stats.get("failed", [])
    rows = [dict(one.user_properties)["hard case"] for one in reports if "hard case" in dict(one.user_properties)]
    if not rows or terminalreporter.verbosity < 1:
        return
    rows = [COLUMNS, *sorted(rows)]
    widths = [max(len(row[k]) for row in rows) for k in range(len(COLUMNS))]
    terminalreporter.section("hard cases")
    for row in rows:
        terminalreporter.write_line("  ".join(map(str.ljust, row, widths)).rstrip())
