"""Progress where there is no terminal."""

from perfcap.app.console import Lines


def test_lines_say_counts_and_what_is_left_and_are_few() -> None:
    now, written = [0.0], []
    lines = Lines(written.append, lambda: now[0])
    for second in range(101):
        now[0] = float(second)
        lines.tell("detect", second * 3, 600)
    assert written[0] == "perfcap: detect 30 of 600, about 3 min left"
    assert written[-1] == "perfcap: detect 300 of 600, about 2 min left"
    assert len(written) == 10


def test_short_stages_say_nothing() -> None:
    now, written = [0.0], []
    lines = Lines(written.append, lambda: now[0])
    for stage in range(50):
        now[0] += 9.0
        lines.tell(f"stage {stage}", 0, 1)
    assert not written
