import importlib.util
from pathlib import Path

EXAMPLES = Path(__file__).parents[1] / "examples"


def test_a_robot_finds_itself(capsys):
    spec = importlib.util.spec_from_file_location("find_yourself", EXAMPLES / "find_yourself.py")
    example = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(example)
    right = example.main(map="rooms(width=8,height=6):0", seed=0, steps=150)
    assert capsys.readouterr().out.startswith("entropy ")
    assert right
