"""The report on the thesis: its data, the numbers in its texts, and where everything is."""

from __future__ import annotations

import csv
import math
import re
import tomllib
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from pvdf_fem import Report, solve
from pvdf_fem.reporting.registry import kinds_of
from pvdf_fem.reporting.solved import Solved
from pvdf_fem.reporting.task import key
from reports import __main__ as reports

THESIS = Path(reports.__file__).parent / "thesis"
CHARGES, CONTOURS, POSITIONS = (
    pd.read_csv(THESIS / f"{name}.csv") for name in ("charges", "contours", "positions")
)
PARAMETERS, POLYNOMIALS = (
    tomllib.loads((THESIS / "printed" / f"{name}.toml").read_text("utf-8"))
    for name in ("parameters", "polynomials")
)
EQUATIONS = {of["id"]: of["coefficients"] for of in POLYNOMIALS["polynomial"]}


#: Places of numbers that are filled in, links, and what tells a place in the thesis.
NO_NUMBER = re.compile(
    r"\{[^}]*\}|\]\([^)]*\)|(?:Fig|Table|[Ss]ection|Chapter|App|Eq)[a-z]*\.? \d[\d.]*"
    r"(?:(?:,| to| and) \d+\.[\d.]*)*|\(\d\.\d\)|[\d.]+ \([A-Z]\)"
)
NUMBER = re.compile(r"\d+(?:\.\d+)?")
WORDS = {5: "five", 9: "nine", 19: "Nineteen"}


def texts() -> dict[str, str]:
    """The texts of the report: of its sections, of the findings and of the numbers."""
    script = tomllib.loads((THESIS / "report.toml").read_text("utf-8"))
    found = {section["title"]: section["text"] for section in script["section"]}
    for name in ("findings", "numbers"):
        with (THESIS / f"{name}.csv").open(encoding="utf-8", newline="") as file:
            cells = [list(row.values()) for row in csv.DictReader(file)]
        # numbers of findings and their places in the thesis are no statements
        columns = slice(2, None) if name == "findings" else slice(None)
        found |= {f"{name} {n}": " ".join(row[columns]) for n, row in enumerate(cells, start=1)}
    return {**found, "": script["text"]}


@pytest.fixture(scope="module")
def report() -> Report:
    return Report.load(THESIS / "report.toml", kinds_of(THESIS / "special.py"))


def test_every_printed_charge_is_there_and_203_count(report):
    assert CHARGES[[*"ABCD"]].notna().sum().sum() == 222
    counted = report.plan.data["charges"].frame
    assert counted[[*"ABCD"]].notna().sum().sum() == 203
    rows = CHARGES[CHARGES.source.str.startswith("Table 4.1")]
    assert rows[[*"ABCD"]].notna().sum().sum() == 84
    assert len(CONTOURS) == 29
    assert POSITIONS.error_mm.notna().sum() == 32 - 6


def test_charges_of_each_kind_of_scene_are_within_2_percent(report):
    readings = report.plan.data["charges"]
    scenes = readings.scenes(report.plan.scene)
    kinds = readings.frame.groupby(["probe.shape", "electrodes.layout"]).head(1).index
    assert len(kinds) == 4
    for row in kinds:
        charges = solve(scenes[row]).charges_pC
        printed = readings.frame.loc[row, list(charges)].to_numpy(float)
        assert [*charges.values()] == pytest.approx(printed, rel=0.02, nan_ok=True)


def of_printed_tables() -> list[tuple[str, str]]:
    """Texts, and parts of them that follow from the printed tables."""
    rows = CHARGES[CHARGES.source == "Table 3.4"].sort_values("force_N")
    slopes = np.diff(np.log(rows[["force_N", "A"]].to_numpy()), axis=0)
    exponents = slopes[:, 1] / slopes[:, 0]
    growth = np.mean([rows[name].iloc[1] / rows[name].iloc[0] for name in "ABC"])
    at_1_N = [sum(EQUATIONS[f"3.4.3_{name}"]) for name in "ABC"]
    turned = CHARGES[CHARGES.source == "Table 4.1"]
    # quarter turns and reflections leave the sensor as it is: this tells which charges are equal
    cosine = np.cos(2.0 * np.radians(turned.rotation_deg.to_numpy()))
    place = np.outer(cosine, [1.0, -1.0, 1.0, -1.0]).round(9).ravel()
    alike = pd.DataFrame({"place": place, "q": turned[[*"ABCD"]].to_numpy().ravel()})
    groups = alike.groupby("place").q
    apart = (groups.max() - groups.min()).max()
    effect = 100.0 * (alike.q.max() / alike.q.min() - 1.0)
    measured = POSITIONS.table.str.startswith("Table 5")
    simulated, distances = POSITIONS[~measured], POSITIONS[measured].error_mm.dropna()
    large = simulated.error_mm[simulated.error_mm > 1.0].tolist()
    dropped = CHARGES[CHARGES.defect.notna()][[*"ABCD"]].notna().sum().sum()
    near = WORDS[int((distances < 1.0).sum())]
    return [
        ("findings 3", f"grow {growth:.2f} times"),
        ("findings 3", f"{exponents.min():.2f} to {exponents.max():.2f}"),
        ("findings 4", "give {:.0f}, {:.0f}, {:.0f} pC".format(*at_1_N)),
        ("findings 5", f"{apart:.2f} pC, {100.0 * apart / alike.q.mean():.1f} %"),
        ("findings 8", f"{simulated.error_mm.isna().sum()} of {len(simulated)} simulated"),
        ("findings 9", f"rotation is {effect:.1f} %"),
        ("findings 10", " and ".join(f"{error:g}" for error in large)),
        ("Printed charges", f"prints {CHARGES[[*'ABCD']].notna().sum().sum()} simulated"),
        ("Printed charges", f"{WORDS[dropped]} do not count"),
        ("Rotation", f"at {math.degrees(math.atan2(7.0, 14.0)):.1f}°"),
        ("Ten touches", f"{near} of the {WORDS[len(distances)]} distances"),
    ]


def of_products_and_the_layout() -> list[tuple[str, str]]:
    """Texts, and parts of them that follow from the polynomials and the printed contours."""
    percents = []
    for product in POLYNOMIALS["product"]:
        name = product["electrode"]
        table = CHARGES[CHARGES.source == {"A": "Table 4.5", "B": "Table 4.6"}[name]]
        rows = table[table.defect.isna() & (table.rotation_deg <= 75.0)]
        angle = np.polyval(product["angle_coefficients"], np.radians(rows.rotation_deg))
        force = np.polyval(product["force_coefficients"], rows.force_N)
        percents += (100.0 * (angle * force / rows[name] - 1.0)).tolist()
    span = f"{min(percents):+.1f} to {max(percents):+.1f} %".replace("-", "−")
    apart = 20.0 * math.sin(math.radians(75.0))
    centres = {"A": (0.0, -10.0), "B": (10.0 * math.cos(math.pi / 6.0), 5.0)}
    radii = []
    for name, at in centres.items():
        points = CONTOURS[CONTOURS[name].notna()][["x_mm", "y_mm"]].to_numpy()
        radii.append(np.linalg.norm(points - at, axis=1).max())
    assert sum(radii) < apart
    layout = f"{apart:.2f} mm apart", "{:.2f} and {:.2f} mm".format(*radii)
    return [("findings 9", span), *(("findings 12", part) for part in layout)]


def of_the_circuit() -> list[tuple[str, str]]:
    """Texts, and parts of them that follow from the printed parameters."""
    film, circuit = PARAMETERS["film"]["biaxial"], PARAMETERS["circuit"]
    area, h = (PARAMETERS["geometry"][k]["value"] for k in ("electrode_area", "film_thickness"))
    permittivity = circuit["epsilon0"]["value"] * film["dielectric_constant"]["value"]
    pF, load = 1e12 * permittivity * area / h, circuit["load_resistance"]["value"]
    reactance = 1e6 / (2.0 * math.pi * 20.0 * pF)
    deficit = 100.0 * (1.0 - circuit["capacitance_measured_two_electrodes"]["value"] / pF)
    series, parallel = 1.0 / math.hypot(1.0, load / reactance), load / math.hypot(load, reactance)
    here = f"{pF:.3f}", f"{deficit:.1f}", f"{reactance:.2f}", f"{series:.3f}", f"{parallel:.3f}"
    printed = circuit["reactance_printed"]["value"]
    return [
        *((f"numbers {n}", f" {part}") for n, part in enumerate(here, start=1)),
        ("findings 11", f"{reactance:.2f} MΩ"),
        ("findings 11", f"{20.0 * reactance / printed:.2f} Hz"),
    ]


FOLLOWING = [*of_printed_tables(), *of_products_and_the_layout(), *of_the_circuit()]


@pytest.mark.parametrize(("text", "part"), FOLLOWING)
def test_numbers_of_texts_follow_from_what_the_thesis_prints(text, part):
    assert part in texts()[text]


def test_all_other_numbers_of_texts_are_printed_or_keys_or_filled_in():
    """So that a number which nothing computes any more is found."""
    files = [*THESIS.glob("*.csv"), *(THESIS / "printed").iterdir()]
    own = {"findings", "numbers", "contents"}
    sources = [path.read_text("utf-8") for path in files if path.stem not in own]
    script = (THESIS / "report.toml").read_text("utf-8")
    sources.append(re.sub(r'^text = ".*"$', "", script, flags=re.MULTILINE))
    known = {float(number) for of in sources for number in NUMBER.findall(of)}
    tolerances = re.findall(r"tolerance\"? = (\S+)", script)
    known |= {float(f"{100.0 * float(given):.6g}") for given in tolerances}
    for name, text in texts().items():
        for where, part in FOLLOWING:
            text = text.replace(part, "") if where == name else text
        left = {number for number in NUMBER.findall(NO_NUMBER.sub("", text))}
        assert {number for number in left if float(number) not in known} == set(), name


def listed() -> set[str]:
    """Figures and tables of the list, each by its name."""
    found = set()
    for text in pd.read_csv(THESIS / "contents.csv")["in the thesis"]:
        word = "Fig."
        for part in re.split(r", ", text):
            word = "Table" if part.startswith("Table") else "Fig." if "Fig" in part else word
            first, *last = re.findall(r"\d+\.\d+", part) or [part]
            chapter, number = first.split(".") if "." in first else (first, "0")
            end = int(last[0].split(".")[1]) if last else int(number or 0)
            found |= {f"{word} {chapter}.{n}" for n in range(int(number or 0), end + 1)}
    return found


def test_every_figure_and_table_that_is_recomputed_is_in_the_list():
    figures = {5, 7, 9, *range(16, 19), *range(20, 26)}
    wanted = {f"Fig. 3.{n}" for n in figures} | {f"Table 3.{n}" for n in range(1, 6)}
    wanted |= {f"Table 4.{n}" for n in range(1, 7)} | {"Table 5.1", "Table 5.2"}
    assert wanted <= listed()


def test_links_of_texts_lead_to_figures_and_files(report):
    names = {item.name for item in report.plan.items}
    for file in ("findings", "numbers", "contents"):
        for link in re.findall(r"\]\(([^)]+)\)", (THESIS / f"{file}.csv").read_text("utf-8")):
            name = re.sub(r"^#|^data/|\.csv$", "", link)
            assert name in names, link


def test_what_is_special_is_made_in_a_preview(report):
    inputs, needed = report.plan.needs(quick=True)
    own = [need for need in needed if need.tasks or need.item.name == "contents"]
    assert len(own) == 4
    tasks = {key(task): task for need in own for task in need.tasks}
    solved = Solved({name: task.run() for name, task in tasks.items()})
    made = {need.item.name: need.item.kind.compose(inputs, solved) for need in own}
    for content in made.values():
        assert not content.frame.astype(str).isin(["nan"]).any(axis=None)
        assert "{" not in content.frame.to_csv()
    assert "<a href=" in made["contents"].shown.to_csv()
    effects = made["effects"].frame.set_index(["probe", "effect"])
    # a tape over A takes more than half of its charge; d33 adds to the electrode under the probe
    assert effects.A_percent["beside A", "tape over each electrode"] < -50.0
    assert effects.B_percent["on a part of A", "d33 = −15 pC/N"] == pytest.approx(0.0, abs=1e-9)
    assert effects.A_percent["on a part of A", "d33 = −15 pC/N"] > 0.0


def test_reports_are_made_by_their_names(tmp_path, monkeypatch, capsys):
    """Each in its folder, with its own arguments, and the landing page has its verdict."""
    title = 'title = "A sensor"\nexample = "triangle"\n'
    other = '[[other]]\ntitle = "How good"\npage = "accuracy/index.html"\nhow = "by hand"\n'
    section = '[[section]]\ntitle = "Found"\n[[section.figure]]\nkind = "found"\n'
    for name, text in {"thesis": title + other + section, "accuracy": title + section}.items():
        folder = tmp_path / name
        folder.mkdir()
        folder.joinpath("report.toml").write_text(text)
        folder.joinpath("special.py").write_text(FOUND.format(claim=name))
    monkeypatch.setattr(reports, "HERE", tmp_path)
    monkeypatch.setattr(reports, "OUT", tmp_path / "out")
    assert reports.main([]) == 0
    page = tmp_path / "out" / "index.html"
    assert "by hand" in page.read_text()
    assert reports.main(["accuracy"]) == 0
    assert "</a>: Accuracy.</li>" in page.read_text()
    assert '<p class="verdict">Thesis.</p>' in page.read_text()
    assert reports.main(["accuracy", "--out", str(tmp_path / "elsewhere")]) == 0
    assert (tmp_path / "elsewhere" / "index.html").is_file()
    assert reports.main(["stability"]) == 2  # has no script there
    assert "stability" in capsys.readouterr().err


FOUND = """
from typing import Literal
import pandas as pd
from pvdf_fem.reporting.kind import Content, Kind

class Found(Kind):
    kind: Literal["found"]

    def compose(self, inputs, solved):
        return Content("", pd.DataFrame(dict(a=[1])), claim="{claim}")
"""


def test_the_landing_page_names_every_other_report(report):
    pages = [Path(other.page) for other in report.plan.others]
    assert [(page.parent.name, page.name) for page in pages] == [
        (name, "index.html") for name in reports.REPORTS if name != reports.DEFAULT
    ]


def test_other_names_of_reports_are_refused(capsys):
    assert reports.main(["thesys"]) == 2
    assert "thesys" in capsys.readouterr().err
    assert reports.main(["--processes", "0"]) == 2
    assert "--processes 0" in capsys.readouterr().err


def test_the_special_part_stays_small():
    assert len((THESIS / "special.py").read_text("utf-8").splitlines()) <= 250
