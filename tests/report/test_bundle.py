"""Modules put together keep their order and their scopes, or are refused."""

import shutil
import subprocess

import pytest

from perfcap.report.page import bundle

MODULES = {
    "main.js": 'import { add, Counter } from "./sums.js";\nimport { two } from "./twos.js";\n'
    "const hidden = 40;\nconsole.log(add(hidden, two) + new Counter().one);",
    "sums.js": "const hidden = 0;\nexport function add(a, b) {\n  return hidden + a + b;\n}\n"
    "export class Counter {\n  constructor() { this.one = 1; }\n}",
    "twos.js": 'import { add } from "./sums.js";\nexport const two = add(1, 1);',
    "unused.js": "import everything;",
}


def test_modules_come_after_those_they_need() -> None:
    script = bundle(MODULES, "main.js")
    places = [script.index(f"const module_{name} =") for name in ("sums", "twos", "main")]
    assert places == sorted(places) and "unused" not in script
    assert script.count("module_sums =") == 1  # though two modules import it


@pytest.mark.skipif(shutil.which("node") is None, reason="needs node to run the script")
def test_scopes_do_not_meet() -> None:
    script = bundle(MODULES, "main.js")
    done = subprocess.run(
        ["node", "--input-type=module", "-e", script], capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == "43"


@pytest.mark.parametrize(
    ("main", "message"),
    [
        ('import { gone } from "./sums.js";', "gone"),
        ('import { x } from "./nowhere.js";', "nowhere.js, which does not exist"),
        ("export default 3;", "cannot bundle 'export default 3;'"),
        ('import * as all from "./sums.js";', "cannot bundle"),
    ],
)
def test_what_it_does_not_understand(main: str, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        bundle(MODULES | {"main.js": main}, "main.js")


def test_circles() -> None:
    modules = {
        "a.js": 'import { b } from "./b.js";',
        "b.js": 'import { a } from "./a.js";\nexport const b = 1;',
    }
    with pytest.raises(ValueError, match=r"a\.js -> b\.js -> a\.js"):
        bundle(modules, "a.js")
