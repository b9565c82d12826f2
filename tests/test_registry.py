"""Component slots: what a name means, what it might have meant, and a user's own classes."""

import pytest

from desim_uav import policies, registry
from desim_uav.errors import did_you_mean
from desim_uav.policies.hover import Hover
from desim_uav.registry import names, register, resolve

SLOT = "tests' own slot"


@pytest.fixture(autouse=True)
def clean_slots(monkeypatch):
    monkeypatch.setattr(registry, "_SLOTS", {k: dict(v) for k, v in registry._SLOTS.items()})


@pytest.fixture
def module(tmp_path, monkeypatch):
    """Write a module of a user's and make it importable."""
    monkeypatch.syspath_prepend(str(tmp_path))

    def write(name, text):
        (tmp_path / f"{name}.py").write_text(text, encoding="utf-8")

    return write


class TestBuiltIns:
    def test_a_registered_class_is_found_and_knows_its_kind(self):
        @register(SLOT, "plain")
        class Plain:
            pass

        assert resolve(SLOT, "plain") is Plain
        assert Plain.kind == "plain"

    def test_names_stand_in_order_of_registration(self):
        for name in ("zebra", "ant", "mole"):
            register(SLOT, name)(type(name, (), {}))
        assert names(SLOT) == ["zebra", "ant", "mole"]

    def test_an_unused_slot_has_no_names(self):
        assert names("nothing is registered here") == []

    def test_slots_do_not_share_names(self):
        @register(SLOT, "hover")
        class Own:
            pass

        assert resolve(SLOT, "hover") is Own
        assert resolve("policy", "hover") is Hover

    def test_a_name_can_be_taken_over(self):
        first, second = type("First", (), {}), type("Second", (), {})
        register(SLOT, "same")(first)
        register(SLOT, "same")(second)
        assert resolve(SLOT, "same") is second
        assert names(SLOT) == ["same"]

    def test_the_built_in_policies(self):
        assert policies.load_policy("hover").kind == "hover"
        assert {"baseline", "hover", "random", "script"} <= set(names("policy"))


class TestUnknownNames:
    @pytest.fixture(autouse=True)
    def two(self):
        for name in ("random_walk", "static"):
            register(SLOT, name)(type(name, (), {}))

    def test_the_nearest_is_suggested_and_all_are_named(self):
        with pytest.raises(ValueError, match="did you mean 'random_walk'") as caught:
            resolve(SLOT, "randm_walk")
        message = str(caught.value)
        assert f"unknown {SLOT} 'randm_walk'" in message
        assert "random_walk, static" in message
        assert "package.module:Class" in message

    @pytest.mark.parametrize("name", ["", "xyz", "STATIONARY-ORBIT"])
    def test_nothing_near_nothing_suggested(self, name):
        with pytest.raises(ValueError, match=r"^unknown .* allowed: random_walk, static") as caught:
            resolve(SLOT, name)
        assert "did you mean" not in str(caught.value)

    def test_did_you_mean(self):
        assert did_you_mean("servce", ["service", "user"]) == " (did you mean 'service'?)"
        assert did_you_mean("qqq", ["service", "user"]) == ""
        assert did_you_mean("service", []) == ""


class TestPlugIns:
    def test_a_class_of_a_module(self, module):
        module("own_walks", "class Drift:\n    pass\n")
        found = resolve(SLOT, "own_walks:Drift")
        assert found.__name__ == "Drift"
        assert found.kind == "own_walks:Drift"

    def test_a_kind_of_its_own_stays(self, module):
        module("own_kinds", "class Drift:\n    kind = 'drift'\n")
        assert resolve(SLOT, "own_kinds:Drift").kind == "drift"

    def test_an_inherited_kind_is_not_its_own(self, module):
        module(
            "own_hover",
            "from desim_uav.policies.hover import Hover\n\nclass Mine(Hover):\n    pass\n",
        )
        assert resolve("policy", "own_hover:Mine").kind == "own_hover:Mine"
        assert Hover.kind == "hover"

    def test_it_need_not_be_registered_and_is_not_listed(self, module):
        module("own_unlisted", "class Drift:\n    pass\n")
        resolve(SLOT, "own_unlisted:Drift")
        assert names(SLOT) == []

    @pytest.mark.parametrize(
        ("name", "text", "cause"),
        [
            ("no_such_module_anywhere:Class", None, "ModuleNotFoundError"),
            ("broken_syntax:Class", "def (", "SyntaxError"),
            ("broken_import:Class", "1 / 0", "ZeroDivisionError: division by zero"),
            (
                "no_such_class:Clas",
                "class Class:\n    pass\n",
                "has no 'Clas' .did you mean 'Class'",
            ),
            ("too_many:parts:Class", "class Class:\n    pass\n", "ModuleNotFoundError"),
            ("no_class_named:", "", "'no_class_named' has no ''"),
            (":Class", None, "ValueError: Empty module name"),
        ],
    )
    def test_what_cannot_be_imported_says_why(self, module, name, text, cause):
        if text is not None:
            module(name.partition(":")[0], text)
        with pytest.raises(ValueError, match=f"cannot import '{name}': .*{cause}"):
            resolve(SLOT, name)

    def test_what_is_no_class(self, module):
        module("not_a_class", "def drift():\n    pass\n")
        with pytest.raises(ValueError, match="'not_a_class:drift' is not a class"):
            resolve(SLOT, "not_a_class:drift")
