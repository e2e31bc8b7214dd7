"""Tables of the pages: words on the left, figures on the right, and only a mark counts as one."""

from pathlib import Path

from probewatch.tools.report.page import section, table, write_page


def test_words_stand_on_the_left_and_figures_on_the_right() -> None:
    """Faults and reasons were aligned on the right, so that no two lines of them began at one place."""
    told = table(("fault", "alarms", "reason"), [("scale", "12", "moved"), ("offset", "!3", "moved again, by 3 mm")])
    assert "<th scope=col>fault</th><th scope=col class=figure>alarms</th><th scope=col>reason</th>" in told
    assert '<td>offset</td><td class="figure bad">3</td><td>moved again, by 3 mm</td>' in told
    assert '<td>scale</td><td class="figure">12</td><td>moved</td>' in told


def test_the_sign_of_a_figure_is_no_mark() -> None:
    """A drift of +0.25 mm was told as 0.25 mm, in the green of what is right."""
    told = table(("parameter", "now", "is"), [("offset-axial", "+0.25 mm", "+passed"), ("zeta", "-0.25 mm", "!near")])
    assert '<td class="figure">+0.25 mm</td><td class="good">passed</td>' in told
    assert '<td class="figure">-0.25 mm</td><td class="bad">near</td>' in told


def test_a_table_without_rows_has_its_headings() -> None:
    assert "<th scope=col>s</th><th scope=col>state</th>" in table(("s", "state"), [])


def test_on_paper_a_long_section_begins_under_the_one_before(tmp_path: Path) -> None:
    """Each was kept whole, so that two of six pages of a recording were blank by half."""
    write_page(tmp_path / "x.html", "x", [section("Parameters", table(("s",), [("1",)]))])
    style = (tmp_path / "x.html").read_text().split("@media print")[1].partition("body { max-width")[0]
    assert "section" not in style
    assert "tr, table, svg, img { break-inside: avoid; }" in style
