"""The house: its rooms, who may import whom, how long a module is. See "Where things are" in the
README."""

import ast
import re
import subprocess
import sys
from pathlib import Path

import pytest

import paperrepro

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("paperrepro", "data_synth")
#: The rooms in the order of imports, each of what stands before it; those of one line do not know
#: each other.
FLOORS = (
    {"errors", "_files", "_cache", "_compiled", "_progress"},
    {"frames"},
    {"survey"},
    {"method"},
    {"flight", "study"},
    {"paper"},
    {"figures"},
    {"cli"},
    {"__main__"},
)
#: What simulator and method share: containers, rotation conventions, the errors both raise, and the
#: threads their loops run on.
SHARED = {"paperrepro.frames", "paperrepro.survey", "paperrepro.errors", "paperrepro._compiled"}
#: Where simulator and method meet; nowhere else is the truth known.
KNOW_THE_TRUTH = {"paperrepro.study.simulated", "paperrepro.cli"}
PLOTTING = {"matplotlib", "seaborn", "plotly", "PIL", "IPython"}
LONGEST_MODULE = 500
MOST_VISIBLE_NAMES = 10


def module_name(path):
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def modules():
    """Name to path of every module of the two packages."""
    return {
        module_name(p): p for package in PACKAGES for p in sorted((ROOT / package).rglob("*.py"))
    }


MODULES = modules()
METHOD = {name for name in MODULES if name.split(".")[0] == "paperrepro"}
SIMULATOR = sorted(name for name in MODULES if name.split(".")[0] == "data_synth")


def imports(source, name, is_package=False):
    """Full names that ``source`` of module ``name`` imports, at any depth.

    ``from a import b`` counts as ``a.b`` where that is a module, else as ``a``; names given as
    text to ``import_module`` or ``__import__`` count too.
    """
    found = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            found.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = _absolute(node, name, is_package)
            inner = {f"{base}.{alias.name}" for alias in node.names}
            found.update(inner & MODULES.keys())
            found.update({base} if inner - MODULES.keys() else ())
        elif isinstance(node, ast.Call) and _called(node) in {"import_module", "__import__"}:
            found.update(
                argument.value for argument in node.args[:1] if isinstance(argument, ast.Constant)
            )
    return found


def _absolute(node, name, is_package):
    if node.level == 0:
        return node.module
    package = name.split(".") if is_package else name.split(".")[:-1]
    kept = package[: len(package) - node.level + 1]
    return ".".join([*kept, *([node.module] if node.module else [])])


def _called(node):
    return getattr(node.func, "attr", getattr(node.func, "id", None))


def imports_of(name):
    path = MODULES[name]
    return imports(path.read_text(encoding="utf-8"), name, path.name == "__init__.py")


def of_package(names, package):
    """Those of ``names`` that are ``package`` or in it."""
    return {name for name in names if name == package or name.startswith(package + ".")}


def room(name):
    """The part of `paperrepro` that module ``name`` lies in; empty for the package itself."""
    return name.partition(".")[2].partition(".")[0]


def floor(name):
    return next((number for number, rooms in enumerate(FLOORS) if room(name) in rooms), -1)


def test_the_packages_are_found():
    assert len(METHOD) > 15
    assert len(SIMULATOR) > 10
    assert "paperrepro.survey" in imports_of("paperrepro.method.georeference")
    assert "paperrepro.method.adjustment.conditions" in imports_of(
        "paperrepro.method.adjustment.scenarios"
    )


@pytest.mark.parametrize(
    "line",
    [
        "import data_synth.farm",
        "from data_synth import simulate",
        "from data_synth.farm import build_farm as build",
        "def late():\n    import data_synth",
        "importlib.import_module('data_synth.farm')",
        "__import__('data_synth')",
    ],
)
def test_an_import_of_the_simulator_is_seen_in_every_form(line):
    assert of_package(imports(line, "paperrepro.method.matching"), "data_synth")


def test_a_relative_import_is_resolved():
    assert imports("from . import survey", "paperrepro.frames") == {"paperrepro.survey"}
    assert imports("from ..survey import Rays", "paperrepro.method.georeference") == {
        "paperrepro.survey"
    }
    inner = imports("from .scene import Scene", "data_synth", is_package=True)
    assert inner == {"data_synth.scene"}


@pytest.mark.parametrize("name", sorted(METHOD - KNOW_THE_TRUTH))
def test_the_method_does_not_know_the_truth(name):
    assert not of_package(imports_of(name), "data_synth")


@pytest.mark.parametrize("name", SIMULATOR)
def test_the_simulator_shares_only_containers_and_conventions(name):
    """Above all not the LiDAR equation: a sign error must not cancel itself."""
    assert of_package(imports_of(name), "paperrepro") <= SHARED


@pytest.mark.parametrize("name", sorted(METHOD))
def test_a_room_needs_only_what_lies_below_it(name):
    for imported in of_package(imports_of(name), "paperrepro") - {"paperrepro"}:
        if room(imported) != room(name) and floor(name) > 0:
            assert floor(imported) < floor(name), f"{name} imports {imported}"


@pytest.mark.parametrize("name", sorted(METHOD))
def test_only_figures_draw(name):
    roots = {imported.split(".")[0] for imported in imports_of(name)}
    assert room(name) == "figures" or not roots & PLOTTING


def test_every_module_lies_in_a_room():
    assert {name for name in METHOD if floor(name) < 0} == {"paperrepro"}


def test_a_visitor_sees_few_names():
    listed = subprocess.run(
        ["git", "ls-files", "paperrepro"], cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout.splitlines()
    visible = {line.split("/")[1] for line in listed if line.split("/")[1][0] != "_"}
    assert len(visible - {"py.typed"}) <= MOST_VISIBLE_NAMES


def test_the_public_names_are_there_and_nothing_else():
    assert set(dir(paperrepro)) == {*paperrepro.API, "__version__"}
    for name, module in paperrepro.API.items():
        assert getattr(paperrepro, name).__module__ == module
    with pytest.raises(AttributeError, match="offers Survey"):
        _ = paperrepro.calibrate_everything


def test_the_door_opens_without_what_lies_behind():
    heavy = ["numpy", "scipy", "pandas", "numba", "open3d", "matplotlib", "dask", "laspy", "pyproj"]
    code = f"import paperrepro, sys; print([m for m in {heavy} if m in sys.modules])"
    loaded = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout
    assert loaded.strip() == "[]"


@pytest.mark.parametrize("package", PACKAGES)
def test_imports_run_one_way(package):
    """No module imports itself through others: what is upstream never needs what is downstream."""
    own = {name: imports_of(name) & MODULES.keys() for name in of_package(MODULES, package)}
    while leaves := {name for name, needed in own.items() if not needed & own.keys()}:
        own = {name: needed for name, needed in own.items() if name not in leaves}
    assert not own, f"these import one another: {sorted(own)}"


@pytest.mark.parametrize("name", sorted(MODULES))
def test_a_module_stays_short(name):
    lines = len(MODULES[name].read_text(encoding="utf-8").splitlines())
    assert lines <= LONGEST_MODULE, f"{name} has {lines} lines; split it by theme"


def test_one_version_everywhere():
    """The package, what pip installs, what is cited, and the last entry of the changes."""
    text = {name: (ROOT / name).read_text() for name in ("pyproject.toml", "CITATION.cff")}
    found = {re.search(r"^version\W+([\d.]+)", words, re.M)[1] for words in text.values()}
    found.add(re.search(r"^## ([\d.]+)", (ROOT / "CHANGELOG.md").read_text(), re.M)[1])
    assert found == {paperrepro.__version__}
