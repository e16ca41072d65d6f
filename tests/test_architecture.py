"""Who may import whom: the method must not know the truth, nor the simulator the method."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("paperrepro", "data_synth")
#: The command line brings simulator and method together; it alone may.
COMMAND_LINE = ("paperrepro.cli", "paperrepro.commands")
#: What simulator and method share: containers, rotation conventions, the errors both raise, and the
#: threads their loops run on.
SHARED = {"paperrepro.frames", "paperrepro.survey", "paperrepro.errors", "paperrepro._compiled"}
PLOTTING = {"matplotlib", "seaborn", "plotly", "PIL", "IPython"}
#: Draws nothing, but packs pictures into a page.
PACKS_PICTURES = "paperrepro.figures.pages"
LONGEST_MODULE = 300


def module_name(path):
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def modules():
    """Name to path of every module of the two packages."""
    return {
        module_name(p): p for package in PACKAGES for p in sorted((ROOT / package).rglob("*.py"))
    }


MODULES = modules()
METHOD = sorted(name for name in MODULES if name.split(".")[0] == "paperrepro")
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


def of_command_line(name):
    return any(of_package({name}, part) for part in COMMAND_LINE)


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
    assert imports("from ..survey import Rays", "paperrepro.method.adjustment.conditions") == {
        "paperrepro.survey"
    }
    inner = imports("from .scene import Scene", "data_synth", is_package=True)
    assert inner == {"data_synth.scene"}


@pytest.mark.parametrize("name", [name for name in METHOD if not of_command_line(name)])
def test_the_method_does_not_know_the_truth(name):
    assert not of_package(imports_of(name), "data_synth")


@pytest.mark.parametrize("name", SIMULATOR)
def test_the_simulator_shares_only_containers_and_conventions(name):
    """Above all not the LiDAR equation: a sign error must not cancel itself."""
    assert of_package(imports_of(name), "paperrepro") <= SHARED


@pytest.mark.parametrize("name", METHOD)
def test_only_figures_and_the_command_line_draw(name):
    roots = {imported.split(".")[0] for imported in imports_of(name)}
    if not of_package({name}, "paperrepro.figures") and not of_command_line(name):
        assert not roots & PLOTTING - ({"PIL"} if name == PACKS_PICTURES else set())
        assert not of_package(imports_of(name), "paperrepro.figures")


@pytest.mark.parametrize(
    "name", [n for n in METHOD if not of_command_line(n) and n != "paperrepro.__main__"]
)
def test_nothing_but_its_entry_imports_the_command_line(name):
    assert not any(of_command_line(imported) for imported in imports_of(name))


@pytest.mark.parametrize("package", PACKAGES)
def test_imports_run_one_way(package):
    """No module imports itself through others: what is upstream never needs what is downstream."""
    own = {name: imports_of(name) & MODULES.keys() for name in of_package(MODULES, package)}
    while leaves := {name for name, needed in own.items() if not needed & own.keys()}:
        own = {name: needed for name, needed in own.items() if name not in leaves}
    assert not own, f"these import one another: {sorted(own)}"


@pytest.mark.parametrize("name", METHOD + SIMULATOR)
def test_a_module_stays_short(name):
    lines = len(MODULES[name].read_text(encoding="utf-8").splitlines())
    assert lines < LONGEST_MODULE, f"{name} has {lines} lines; split it by theme"
