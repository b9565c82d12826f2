"""Machine code on disk is that of the sources as they stand."""

import subprocess
import sys

from tests.command_line import ROOT

SOURCE = """
from desim_uav.model.kernels import kernel

@kernel
def of_one_s_own(x):
    return {factor} * x
"""


def said_by(folder, factor):
    (folder / "mine.py").write_text(SOURCE.format(factor=factor))
    command = [sys.executable, "-c", "import mine; print(mine.of_one_s_own(1.0))"]
    paths = {"PYTHONPATH": f"{folder}:{ROOT}"}
    done = subprocess.run(command, capture_output=True, text=True, check=True, env=paths)
    return float(done.stdout)


def test_a_kernel_of_one_s_own_is_compiled_anew_when_a_number_in_it_changes(tmp_path):
    """Nothing but a constant: its byte code, of which Numba keeps account, stays the same."""
    assert said_by(tmp_path, 2.5) == 2.5
    assert list(tmp_path.glob("__pycache__/*.nbc"))
    assert said_by(tmp_path, 3.5) == 3.5
