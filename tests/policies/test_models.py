"""Models in memory, of other libraries and of our own, are policies."""

import subprocess
import sys

import pytest

import desim_uav as du
from desim_uav.errors import PolicyError
from tests.policies.test_mlp import network, small

SHORT = {"episode.steps": 6}


def test_a_network_of_ours_flies_as_its_file_does(tmp_path):
    (tmp_path / "net.npz").write_bytes(network().to_bytes())
    one = du.run(small(), policy=network(), episodes=2)
    other = du.run(small(), policy=tmp_path / "net.npz", episodes=2)
    assert one.steps.equals(other.steps)
    assert one.policy == "desim_uav.policies.mlp:Mlp"


def test_a_network_without_a_description():
    whole = network()
    del whole.about["features"]
    with pytest.raises(PolicyError, match=r"description has no features; .*description_of"):
        du.run(small(), policy=whole)


class TestModulesOfTorch:
    @pytest.fixture
    def nn(self):
        return pytest.importorskip("torch").nn

    def test_the_best_allowed_action_is_taken(self, nn):
        """Its numbers are the bias: the action ``left`` is the best one wherever it is allowed."""
        torch = pytest.importorskip("torch")
        world = du.build_world(du.load("case8"), 0)
        names = [action.name.lower() for action in world.actions]
        one = nn.Linear(len(world.features_of_types[0]), len(names))
        with torch.no_grad():
            one.weight.zero_()
            one.bias.copy_(torch.tensor([float(name == "left") for name in names]))
        steps = du.run("case8", SHORT, policy=one).steps
        other = du.run("case8", SHORT, policy=lambda seen, mask: "left").steps
        assert steps.equals(other)
        assert "left" in set(steps["action"])

    def test_it_is_left_in_the_mode_of_training_that_it_was_in(self, nn):
        world = du.build_world(du.load("case1"), 0)
        sizes = len(world.features_of_types[0]), len(world.actions)
        one = nn.Sequential(nn.Linear(*sizes), nn.Dropout(0.5))
        runs = [du.run("case1", SHORT, policy=one).steps for _ in range(2)]
        assert runs[0].equals(runs[1])
        assert one.training

    def test_what_does_not_fit(self, nn):
        world = du.build_world(du.load("case8"), 0)
        seen, actions = len(world.features_of_types[0]), len(world.actions)
        for module, part in (
            (nn.Linear(seen, actions + 1), f"makes numbers (1, {actions + 1})"),
            (nn.Linear(seen + 1, actions), f"it fails on observations float32 (1, {seen})"),
            (nn.LSTM(seen, actions), "it returns a tuple"),
            (nn.Module(), "NotImplementedError"),
        ):
            with pytest.raises(PolicyError) as caught:
                du.run("case8", SHORT, policy=module)
            assert part in str(caught.value)
            assert f"needed is a tensor (1, {actions})" in str(caught.value)


class TestModelsOfStableBaselines:
    @pytest.fixture
    def sb3(self):
        return pytest.importorskip("stable_baselines3")

    def model(self, sb3, env):
        return sb3.PPO("MlpPolicy", env, n_steps=8, batch_size=8, seed=1)

    def test_one_flies_as_its_file_does(self, sb3, tmp_path):
        model = self.model(sb3, du.UavEnv("case8", SHORT))
        model.save(tmp_path / "model.zip")
        one = du.run("case8", SHORT, policy=model)
        other = du.run("case8", SHORT, policy=tmp_path / "model.zip")
        assert one.steps.equals(other.steps)
        assert one.policy == "stable_baselines3.ppo.ppo:PPO"

    def test_one_that_saw_normalized_observations(self, sb3):
        common = pytest.importorskip("stable_baselines3.common.vec_env")
        radar = SHORT | {"observation.kind": "radar"}
        env = common.VecNormalize(common.DummyVecEnv([lambda: du.UavEnv("case8", radar)]))
        with pytest.raises(PolicyError, match="VecNormalize"):
            du.run("case8", radar, policy=self.model(sb3, env))


@pytest.mark.thorough
def test_no_library_is_imported_to_tell_what_a_policy_is():
    code = (
        "import sys, desim_uav as du\n"
        "du.load_policy(lambda seen, mask: 'hover')\n"
        "print(sorted({'torch', 'ray', 'stable_baselines3'} & set(sys.modules)))\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
