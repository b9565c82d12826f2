"""What of Ray can be tested without it: where its words go, and addresses that are none."""

from __future__ import annotations

import sys
import types

import pytest

from desim_uav.errors import UsageError
from desim_uav.experiment.sweep import on_ray


@pytest.fixture
def talking(monkeypatch: pytest.MonkeyPatch) -> types.SimpleNamespace:
    """A Ray that can be joined."""
    ray = types.SimpleNamespace(init=lambda *_, **__: None, shutdown=lambda: None)
    monkeypatch.setattr(on_ray, "import_ray", lambda: ray)
    return ray


@pytest.mark.parametrize(("quiet", "said"), [(True, ""), (False, "a node has died\nits state\n")])
def test_what_ray_says_of_its_nodes(talking, capsys, quiet: bool, said: str):
    with on_ray.ray_backend(None, None, quiet):
        print("a node has died")
        print("its state", file=sys.stderr)
    assert capsys.readouterr() == ("", said)


@pytest.mark.parametrize("address", ["head", "head:port", ":6379", "head:99999"])
def test_what_is_no_address(talking, address: str):
    with pytest.raises(UsageError, match="write auto or HOST:PORT"), on_ray.ray_backend(1, address):
        pass


def test_nobody_at_the_address(talking):
    address = "127.0.0.1:1"
    complaint = f"--address {address}: no Ray cluster answers there: "
    with pytest.raises(UsageError, match=complaint), on_ray.ray_backend(1, address):
        pass
