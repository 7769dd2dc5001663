"""Effect files that are wrong in any way: one line that names the file or the attribute, and nothing is left behind."""

import pytest

from visaug.app.cli import main
from visaug.core.errors import InputError
from visaug.effects import Effect, Parameter, Stage, catalogue, load_file, register, registered

HEAD = "from visaug import Effect, Parameter, Stage\n"
GOOD = HEAD + (
    "class Fine(Effect):\n    name = 'fine_one'\n    stage = Stage.READOUT\n"
    "    sigma_e = Parameter(0.0, strength=True)\n"
    "    def apply(self, signal, p, stream, context):\n        return signal\n"
)
BODIES = {
    "exit": "import sys\nsys.exit(0)",
    "own base exception": "class Odd(BaseException): pass\nraise Odd('x')",
    "exception without a text": "class Odd(Exception):\n    def __str__(self): raise ValueError\nraise Odd",
    "missing module": "import no_such_module_at_all",
    "syntax": "def (",
    "zero byte": "a = '\0'",
    "recursion": "def f(): f()\nf()",
    "no effect": "a = 1",
}
ATTRIBUTES = {
    "name": "name = 5",
    "name with markup": "name = '[red]x'",
    "name with a space": "name = 'a b'",
    "stage": "stage = 3",
    "summary": "summary = ['x']",
    "equation": "equation = None",
    "order": "order = 'first'",
    "infinite order": "order = float('nan')",
    "differentiable": "differentiable = 'yes'",
    "parameters": "parameters = 3",
    "parameter called name": "map = Parameter(0.0)",
    "default outside": "sigma_e = Parameter(-1.0)",
    "default of a wrong type": "sigma_e = Parameter('much')",
    "low above high": "sigma_e = Parameter(1.0, low=2.0, high=1.0)",
    "NaN": "sigma_e = Parameter(float('nan'))",
    "low": "sigma_e = Parameter(1.0, low='0')",
    "unit": "sigma_e = Parameter(1.0, unit=1)",
    "trials": "sigma_e = Parameter(1.0, trials=3)",
    "trial outside": "sigma_e = Parameter(1.0, trials=(-1,))",
    "options": "kind = Parameter('a', options='ab')",
    "special cases": "special_cases = ({'sigma_e': 1.0}, 'row_noise')",
    "special case without values": "special_cases = (({}, 'row_noise'),)",
    "special case of no parameter": "special_cases = (({'sigma': 1.0}, 'row_noise'),)",
    "special case outside": "special_cases = (({'sigma_e': -1.0}, 'row_noise'),)",
    "apply": "apply = 3",
}
APPLIES = {
    "nothing": ("pass", "returns NoneType"),
    "another shape": ("return signal[..., :-1]", "returns shape (2, 3, 96, 127)"),
    "not finite": ("return signal / (p.sigma_e - 1)", "NaN or infinite"),
    "in place": ("signal += 1; return signal", "in place"),
    "an exception": ("return signal / p.none", "line 7: AttributeError"),
}


def refused(tmp_path, text):
    before = set(catalogue())
    file = tmp_path / "mine.py"
    file.write_text(text)
    with pytest.raises(InputError) as error:
        load_file(file)
    assert "\n" not in str(error.value)
    assert set(catalogue()) == before
    return str(error.value)


@pytest.mark.parametrize("body", BODIES.values(), ids=BODIES)
def test_files_that_do_not_run(tmp_path, body):
    refused(tmp_path, body)


@pytest.mark.parametrize("line", ATTRIBUTES.values(), ids=ATTRIBUTES)
def test_attributes_that_are_wrong(tmp_path, line):
    # The second class is right: a file is registered whole or not at all.
    refused(
        tmp_path,
        GOOD.replace("fine_one", "fine_two") + GOOD[len(HEAD) :].replace("Fine", "Wrong") + f"    {line}\n",
    )


@pytest.mark.parametrize(("body", "said"), APPLIES.values(), ids=APPLIES)
def test_an_apply_that_is_wrong_is_told_when_the_file_is_loaded(tmp_path, body, said):
    text = GOOD.replace("strength=True", "strength=True, trials=(1.0,)").replace("return signal", body)
    assert said in refused(tmp_path, text)


def test_an_effect_of_a_place_that_small_frames_lack_is_loaded(tmp_path):
    text = GOOD.replace("fine_one", "fine_five").replace("strength=True", "strength=True, trials=(1.0,)")
    body = "signal = signal.clone(); signal[..., 900] = 0; return signal"
    (tmp_path / "mine.py").write_text(text.replace("return signal", body))
    with registered():
        assert [effect.name for effect in load_file(tmp_path / "mine.py")] == ["fine_five"]


def test_a_registered_class_is_checked_too():
    with pytest.raises(InputError, match="name"):
        register(type("Odd", (Effect,), {"name": 5, "stage": Stage.READOUT, "a": Parameter()}))


def test_the_program_goes_on_after_a_bad_file(tmp_path, capsys):
    bad, good = tmp_path / "bad.py", tmp_path / "good.py"
    bad.write_text(BODIES["exit"])
    good.write_text(
        GOOD.replace("fine_one", "fine_three") + "    summary = '[/b] [red]as it is[/] \\x1b[2J'\n"
    )
    with registered():
        with pytest.raises(SystemExit) as end:
            main(["effects", "--effects", str(bad)])
        assert end.value.code == 2
        assert "bad.py: cannot be imported: SystemExit" in capsys.readouterr().err
        main(["effects", "--effects", str(good)])
        said = capsys.readouterr().out
        assert "[/b] [red]as it is[/] \\x1b[2J" in said


def test_an_effect_that_fails_is_told_by_file_and_line(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.py").write_text(
        GOOD.replace("fine_one", "fine_four").replace("return signal", "return signal / p.none")
    )
    (tmp_path / "camera.yaml").write_text(
        "{resolution: [8, 8], gain_e_per_dn: 1.0, effects: [{name: fine_four, sigma_e: 1.0}]}"
    )
    (tmp_path / "plan.csv").write_text("sequence,file,kind\n0,a.npy,bias\n")
    with registered():
        load_file(tmp_path / "mine.py")
        with pytest.raises(SystemExit) as end:
            main(["simulate", "plan.csv", "--camera", "camera.yaml", "-o", "out"])
        assert end.value.code == 2
        assert "mine.py: line 7: AttributeError" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (GOOD.replace("    name = 'fine_one'\n", ""), "Fine has no name"),
        (GOOD[: GOOD.index("    def apply")], "apply: expected a method"),
        (GOOD + GOOD[len(HEAD) :].replace("Fine", "Second"), "'fine_one' is taken by Fine"),
    ],
    ids=["no name", "no apply", "one name twice"],
)
def test_what_a_class_lacks_is_named(tmp_path, text, said):
    assert said in refused(tmp_path, text)


def test_an_effect_without_a_strength_breaks_a_law(tmp_path, capsys):
    """Nothing says where it vanishes, and no diagnosis can try it."""
    file = tmp_path / "mine.py"
    file.write_text(GOOD.replace("strength=True", "unit='e-', source='none'"))
    with pytest.raises(SystemExit, match="2"):
        main(["effects", "check", str(file)])
    assert "no parameter has strength=True" in " ".join(capsys.readouterr().out.split())
