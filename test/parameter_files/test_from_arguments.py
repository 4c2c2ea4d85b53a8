import pytest
from refusals import faults_of

from phd_jdtc_ros.parameter_files import from_arguments

NESTED = {"a": 1, "b": {"c": [1, 2], "d": {"e": "f"}}, "g.h": None}


def write(path, text):
    path.write_text(text)
    return path


def test_nested_names_are_joined_with_dots(tmp_path):
    expected = [("a", 1), ("b.c", [1, 2]), ("b.d.e", "f"), ("g.h", None)]
    assert list(from_arguments.flatten(NESTED)) == expected
    assert list(from_arguments.flatten({})) == []
    text = "/a: {north: {tracker: {ros__parameters: {lag: 2}}}}\n"
    assert from_arguments.load(write(tmp_path / "p.yaml", text)) == {"lag": 2}


@pytest.mark.parametrize(
    "section",
    [
        "/**",
        "'**'",
        "/*",
        "tracker",
        "/tracker",
        "/**/tracker",
        "/*/tracker",
        "/north/tracker",
        "north/tracker",
        "/a/north/tracker",
        "/a/*/tracker",
        "/north/**",
    ],
)
def test_load_reads_the_sections_that_apply_to_the_tracker(tmp_path, section):
    text = f"{section}:\n  ros__parameters:\n    a.b: 3\n    radar_1: {{range_std: 50.0}}\n"
    found = from_arguments.load(write(tmp_path / "p.yaml", text))
    assert found == {"a.b": 3, "radar_1.range_std": 50.0}


@pytest.mark.parametrize("first", ["tracker", "/**"])
def test_load_lets_the_later_section_win_as_ros_does_and_skips_other_nodes(tmp_path, first):
    sections = {
        "tracker": "tracker: {ros__parameters: {lag: 2}}\n",
        "/**": "/**: {ros__parameters: {lag: 1, seed: 7}}\n",
    }
    text = sections.pop(first) + "evaluator: {ros__parameters: {cutoff: 5.0}}\n"
    found = from_arguments.load(write(tmp_path / "p.yaml", text + "".join(sections.values())))
    assert found == {"lag": 1 if first == "tracker" else 2, "seed": 7}


@pytest.mark.parametrize(
    ("section", "applies"),
    [
        ("/**", True),
        ("/**/tracker", True),
        ("/*/tracker", True),
        ("/north/**", True),
        ("/north/*", True),
        ("/*", False),
        ("/south/**", False),
        ("/north/trackers", False),
        ("/*/*/tracker", False),
    ],
)
def test_load_takes_what_fits_the_full_name_of_the_tracker(tmp_path, section, applies):
    text = (
        "/north/tracker: {ros__parameters: {seed: 1}}\n"
        f"{section}: {{ros__parameters: {{lag: 2}}}}\n"
    )
    found = from_arguments.load(write(tmp_path / "p.yaml", text))
    assert found == ({"seed": 1, "lag": 2} if applies else {"seed": 1})


def test_load_refuses_files_that_are_not_of_one_tracker(tmp_path):
    text = "".join(f"/{name}/tracker: {{ros__parameters: {{lag: 2}}}}\n" for name in "ba")
    (fault,) = faults_of(from_arguments.load, write(tmp_path / "p.yaml", text))
    assert fault == (
        f"{tmp_path / 'p.yaml'}: has sections of several trackers, /a/tracker, /b/tracker: "
        "must be one"
    )
    (missing,) = faults_of(from_arguments.load, tmp_path / "none.yaml")
    assert missing == f"{tmp_path / 'none.yaml'}: cannot be read: No such file or directory"
    (directory,) = faults_of(from_arguments.load, tmp_path)
    assert directory == f"{tmp_path}: cannot be read: Is a directory"


@pytest.mark.parametrize(
    "text",
    ["", "- 1\n", "text", "lag: 3\n", "tracker: {lag: 3}\n", "tracker: {ros__parameters: 3}\n"],
)
def test_load_refuses_a_file_without_a_section(tmp_path, text):
    (fault,) = faults_of(from_arguments.load, write(tmp_path / "p.yaml", text))
    assert fault == f"{tmp_path / 'p.yaml'}: has no ros__parameters under a node's name"


CLOCK = "/**: {ros__parameters: {use_sim_time: true, qos_overrides: {/a: {depth: 3}}}}\n"
ONLY = "/** (only use_sim_time, qos_overrides./a.depth)"


@pytest.mark.parametrize("node", ["tracker", "asterix_bridge"])
def test_file_for_other_nodes_beside_a_clock_for_all_is_refused(tmp_path, node):
    path = write(tmp_path / "p.yaml", f"{CLOCK}/north/{node}s: {{ros__parameters: {{lag: 2}}}}\n")
    (fault,) = faults_of(from_arguments.from_arguments, [path], [], node)
    assert fault == (
        f"{path}: has no section for this node, {node} in any namespace; it has {ONLY}, "
        f"/north/{node}s"
    )


def test_of_two_files_one_may_be_for_other_nodes(tmp_path, capsys):
    mine = write(tmp_path / "1.yaml", f"{CLOCK}/**/tracker: {{ros__parameters: {{lag: 2}}}}\n")
    other = write(tmp_path / "2.yaml", f"{CLOCK}planner: {{ros__parameters: {{lag: 3}}}}\n")
    clock = write(tmp_path / "3.yaml", CLOCK)
    assert from_arguments.from_arguments([mine, other, clock], []) == {"lag": 2}
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"{other}: has no section for this node, tracker in any namespace; ")
    assert faults_of(from_arguments.from_arguments, [other, clock], [])
    assert from_arguments.from_arguments([clock], ["use_sim_time:=true"]) == {}


@pytest.mark.parametrize(
    ("text", "astray"),
    [
        ("tracker: {ros_parameters: {lag: 3, seed: 1}}\n", "/tracker/ros_parameters/lag"),
        ("ros__parameters: {tracker: {lag: 3}}\n", "/ros__parameters/tracker/lag"),
        ("tracker: {lag: 3, ros__parameters: {seed: 1}}\n", "/tracker/lag"),
        ("tracker: {ros__parameters: }\n", "/tracker/ros__parameters"),
        ("tracker:\n", "/tracker"),
    ],
)
def test_parameter_outside_of_a_section_is_refused_as_ros_does(tmp_path, text, astray):
    path = write(tmp_path / "p.yaml", CLOCK + text)
    (fault,) = faults_of(from_arguments.load, path)
    assert fault == f"{path}: {astray}: must be under ros__parameters of a node's name"


@pytest.mark.parametrize(
    "content", [b"a: [1,", b"\xff\xfe", b"!!python/object:os.system {}", b"\t"]
)
def test_load_refuses_what_is_no_yaml(tmp_path, content):
    path = tmp_path / "p.yaml"
    path.write_bytes(content)
    (fault,) = faults_of(from_arguments.load, path)
    assert fault.startswith(f"{path}: is not YAML: ")


@pytest.mark.parametrize(
    ("encoding", "line", "byte"), [("latin-1", 3, "0xe9"), ("utf-16", 1, "0xff")]
)
def test_load_asks_for_utf_8(tmp_path, encoding, line, byte):
    path = tmp_path / "p.yaml"
    text = "\ntracker: {ros__parameters: {lag: 3}}\n# caf\u00e9\n"
    path.write_bytes(text.encode(encoding))
    (fault,) = faults_of(from_arguments.load, path)
    assert fault == (f"{path}: is not YAML: line {line}: byte {byte} is not UTF-8, as it must be")


def test_load_names_the_line_of_broken_yaml(tmp_path):
    path = write(tmp_path / "p.yaml", "tracker:\n  lag: [1, 2\n  seed: 3\n")
    (fault,) = faults_of(from_arguments.load, path)
    assert fault.startswith(f"{path}: is not YAML: line 3, column 7: while parsing a flow sequence")
    assert "unicode string" not in fault


def test_from_arguments_lets_the_last_one_win_and_explains_quotes(tmp_path):
    one = write(tmp_path / "1.yaml", "tracker: {ros__parameters: {lag: 1, seed: 1}}\n")
    two = write(tmp_path / "2.yaml", "tracker: {ros__parameters: {lag: 2, interval_s: 2.5}}\n")
    found = from_arguments.from_arguments([one, two], ["seed:=3", "seed:=4"])
    assert found == {"lag": 2, "seed": 4, "interval_s": 2.5}
    (fault,) = faults_of(from_arguments.from_arguments, [], ["radar_1.fields.amplitude:="])
    assert fault.startswith("-p radar_1.fields.amplitude:=: must be NAME:=VALUE; ")
    assert fault.endswith("""an empty string is -p "NAME:=''\"""")


@pytest.mark.parametrize(
    ("assignment", "expected"),
    [
        ("a:=1", {"a": 1}),
        ("a:=1.5", {"a": 1.5}),
        ("a:=true", {"a": True}),
        ("a:=text", {"a": "text"}),
        ("a:='1'", {"a": "1"}),
        ("a:=''", {"a": ""}),
        ('a:=""', {"a": ""}),
        ("a:=1e-6", {"a": 1e-6}),
        ("a:=[1, 2.5]", {"a": [1, 2.5]}),
        ("a.b:=/topic", {"a.b": "/topic"}),
        ("a:=b:=c", {"a": "b:=c"}),
    ],
)
def test_from_arguments_reads_values_as_yaml(assignment, expected):
    assert from_arguments.from_arguments([], [assignment]) == expected


@pytest.mark.parametrize("assignment", ["lag:=[1,", "lag:={", "lag:=a: b: c", "lag:=\t"])
def test_from_arguments_refuses_a_value_that_is_no_yaml(assignment):
    (fault,) = faults_of(from_arguments.from_arguments, [], [assignment])
    assert fault.startswith(f"-p {assignment}".rstrip())


def test_from_arguments_lists_every_fault(tmp_path):
    found = faults_of(from_arguments.from_arguments, [tmp_path / "none.yaml"], ["lag", "seed=1"])
    assert found == [
        f"{tmp_path / 'none.yaml'}: cannot be read: No such file or directory",
        "-p lag: must be NAME:=VALUE",
        "-p seed=1: must be NAME:=VALUE",
    ]
