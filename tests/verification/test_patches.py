"""What sepv changes in other packages is still needed: a test that fails here says that its patch can go."""

from pathlib import Path

import pytest
from doors import python
from hypothesis.internal.conjecture import providers
from llvmlite import ir

from sepv._patches import add_attribute, without_local_constants

WIDTH = '"prefer-vector-width"="512"'


def test_numba_imports_scipy_linalg_for_a_question_and_the_patch_puts_that_off(tmp_path: Path) -> None:
    say = "import sys, numba.np.arraymath; print('scipy.linalg' in sys.modules)"
    assert python(say, folder=tmp_path) == "True"
    patched = f"from sepv._patches import put_off_blas; put_off_blas(); {say}"
    assert python(patched, folder=tmp_path) == "False"


def test_llvmlite_refuses_an_attribute_that_llvm_knows_and_the_patch_adds_it() -> None:
    function = ir.Function(ir.Module(), ir.FunctionType(ir.VoidType(), ()), "f")
    with pytest.raises(ValueError, match="unknown attr"):
        function.attributes.add(WIDTH)
    add_attribute(function.attributes, WIDTH)
    assert WIDTH in str(function)


def test_hypothesis_reads_constants_of_loaded_modules_and_the_patch_hides_them(tmp_path: Path) -> None:
    (tmp_path / "full_of_constants.py").write_text("SEEN = [0.123, 4.5, 6.75e3]\n")
    say = "from hypothesis.internal.conjecture import providers as p; print(0.123 in p._get_local_constants().floats)"
    assert python(f"import full_of_constants; {say}", folder=tmp_path) == "True"
    before = providers._get_local_constants
    with without_local_constants():
        assert providers._get_local_constants() == providers.Constants()
    assert providers._get_local_constants is before
