"""A broken plugin costs its own name and nothing else."""

from __future__ import annotations

from importlib.metadata import EntryPoint
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from distributions import gesture, make_distribution

from gesture_core.errors import ConfigError, MissingDependencyError, PluginError
from gesture_core.plugin import hookimpl, registry
from gesture_core.plugin.hooks import Register
from gesture_core.plugin.registry import Origin, Registry, load_registry, register_module


def registered(
    hook: str, *calls: dict[str, Any], origin: str = "other", found: Registry | None = None
) -> Registry:
    """A registry after a plugin from ``origin`` made ``calls`` in ``hook``."""

    def implementation(register: Register) -> None:
        for call in calls:
            register(**call)

    found = found or Registry()
    module = SimpleNamespace(**{hook: hookimpl(implementation)})
    register_module(found, module, Origin("point", origin, "1.0"))
    return found


def test_all_built_in_plugins_import() -> None:
    found = registry()
    assert not found.faults
    for kind, name in found.entries:
        if not found.find(kind, name).missing:
            assert found.load(kind, name)


def test_an_unknown_name_lists_the_nearest() -> None:
    with pytest.raises(PluginError, match="did you mean gaussian") as caught:
        registry().find("filter", "gausian")
    assert caught.value.code == "E_PLUGIN_UNKNOWN"


def test_two_distributions_with_one_name_make_it_ambiguous() -> None:
    call = {"name": "soft", "target": "json:JSONDecoder"}
    found = registered("register_filters", call, origin="first")
    registered("register_filters", call, origin="second", found=found)
    with pytest.raises(PluginError, match=r"first 1\.0 and second 1\.0"):
        found.find("filter", "soft")
    assert found.names("filter", usable=True) == ()


def test_mistakes_become_faults() -> None:
    found = registered(
        "register_filters",
        {"name": "good", "target": "json:JSONDecoder"},
        {"name": "good", "target": "json:JSONEncoder"},
        {"name": "Bad Name", "target": "json:JSONDecoder"},
        {"name": "bad-target", "target": "json"},
        {"name": "bad-needs", "target": "json:JSONDecoder", "needs": "torch"},
        {"name": "no-needs", "target": "json:JSONDecoder", "needs": None},
    )
    assert found.load("filter", "good").__name__ == "JSONDecoder"
    assert [fault.name for fault in found.faults] == [
        "good",
        "Bad Name",
        "bad-target",
        "bad-needs",
        "no-needs",
    ]
    misspelled = registered("register_filtres", {"name": "x", "target": "json:loads"})
    assert "register_filters" in misspelled.faults[0].cause


def test_a_hook_that_raises_costs_only_its_own_kind() -> None:
    def fails(register: Register) -> None:
        register(name="early", target="json:loads")
        raise SystemExit("no")

    def works(register: Register) -> None:
        register(name="fine", target="json:loads")

    found = Registry()
    module = SimpleNamespace(register_filters=hookimpl(fails), register_selectors=hookimpl(works))
    register_module(found, module, Origin("point", "other", "1.0"))
    assert found.find("selector", "fine")
    assert "SystemExit" in found.faults[0].cause


def test_an_import_error_is_a_fault_and_is_named_when_asked_for() -> None:
    point = EntryPoint("broken", "no_such_module_anywhere", "gesture_core")
    found = load_registry([point])
    assert "no_such_module_anywhere" in found.faults[0].cause
    with pytest.raises(PluginError, match="no_such_module_anywhere"):
        found.find("filter", "whatever")


def test_a_missing_dependency_names_the_command() -> None:
    found = registered(
        "register_pose_backends",
        {"name": "far", "target": "far:Far", "needs": ("no_such_module",), "extra": "far"},
        origin="far-away",
    )
    with pytest.raises(MissingDependencyError, match=r"needs no_such_module: pip install 'far-away\[far\]'"):
        found.load("pose", "far")


def test_a_need_whose_package_fails_to_import_is_missing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "needs_a_driver").mkdir()
    (tmp_path / "needs_a_driver" / "__init__.py").write_text("raise OSError('no driver')\n")
    monkeypatch.syspath_prepend(tmp_path)
    call = {"name": "far", "target": "far:Far", "needs": ("needs_a_driver.part",)}
    assert registered("register_filters", call).names("filter", usable=True) == ()


def test_options_that_a_plugin_does_not_take_are_a_setting_error() -> None:
    with pytest.raises(ConfigError, match="gaussian") as caught:
        registry().make("filter", "gaussian", {"sigmaa": 2})
    assert "gesture plugins gaussian" in str(caught.value)


class Fragile:
    def __init__(self, wanted: object = None) -> None:
        raise LookupError(f"nothing like {wanted}")


def test_a_plugin_that_raises_as_it_is_made_is_named() -> None:
    found = registered("register_filters", {"name": "fragile", "target": f"{__name__}:Fragile"})
    with pytest.raises(
        PluginError, match=r"filter 'fragile' of other 1\.0 raised LookupError: nothing like 3"
    ):
        found.make("filter", "fragile", {"wanted": 3})
    if registry().find("kernel", "torch").missing:
        return
    with pytest.raises(ConfigError, match="where 'nonsense' is no device"):
        registry().make("kernel", "torch", {"where": "nonsense"})


def test_a_broken_distribution_is_a_line_and_the_rest_works(tmp_path: Path) -> None:
    make_distribution(tmp_path, "bad-import", "import no_such_module_anywhere\n")
    make_distribution(tmp_path, "bad-exit", "raise SystemExit(3)\n")
    make_distribution(
        tmp_path,
        "clash",
        """
        from gesture_core import hookimpl

        @hookimpl
        def register_filters(register):
            register("gaussian", "json:JSONDecoder")
        """,
    )
    listed = gesture("plugins", path=tmp_path)
    assert listed.returncode == 0, listed.stderr
    assert "no_such_module_anywhere" in listed.stdout
    assert "SystemExit" in listed.stdout
    assert "ambiguous" in listed.stdout
    assert gesture("plugins", "--check", path=tmp_path).returncode == 3
    asked = gesture("plugins", "gaussian", path=tmp_path)
    assert asked.returncode != 0
    assert "clash 1.0" in asked.stderr and "gesture-core" in asked.stderr


def test_check_finds_what_only_making_a_plugin_shows(tmp_path: Path) -> None:
    make_distribution(
        tmp_path,
        "faulty",
        """
        from gesture_core import hookimpl

        class Blind:
            skeleton, batch_size = "coco18", 1
            def estimate(self, frames, people="single"): return [[] for _ in frames]

        class Needy:
            def __init__(self, wanted): self.wanted = wanted

        class Raising:
            def __init__(self): raise LookupError("nothing here")

        class Idle: pass

        @hookimpl
        def register_pose_backends(register): register("blind", "faulty:Blind")

        @hookimpl
        def register_filters(register): register("needy", "faulty:Needy")

        @hookimpl
        def register_selectors(register): register("raising", "faulty:Raising")

        @hookimpl
        def register_normalizers(register): register("idle", "faulty:Idle")
        """,
    )
    checked = gesture("plugins", "--check", path=tmp_path)
    assert checked.returncode == 3
    shown = " ".join(checked.stdout.split())
    assert "its constructor takes no 'model'" in shown
    assert "raised LookupError: nothing here" in shown
    assert "it has no normalize, as every normalizer does" in shown
    (needy,) = (line for line in checked.stdout.splitlines() if '"needy"' in line)
    assert '"ok"' in needy  # its option has no default, so that only the user can make it
