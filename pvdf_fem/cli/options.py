"""Options that several subcommands have, and functions that read their values."""

from __future__ import annotations

import argparse
import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple, NoReturn

from pvdf_fem.cli.program import InputError, print_errors, shorten
from pvdf_fem.scene.scene_file import SceneError, parse_change, quote, read_key_texts, suggest

if TYPE_CHECKING:
    from pvdf_fem.scene.scene import Scene

MAX_QUOTED = 60  #: Maximum number of characters of a value that an error message repeats.


class ArgumentParser(argparse.ArgumentParser):
    """A parser that keeps the line breaks of help texts and prints short error messages.

    Error messages are shortened to one line of printable characters. For an unknown subcommand,
    the most similar one is suggested.
    """

    def __init__(self, *arguments: Any, **options: Any) -> None:
        layout: dict[str, Any] = {
            "formatter_class": argparse.RawDescriptionHelpFormatter,
            "allow_abbrev": False,
        }
        super().__init__(*arguments, **(layout | options))

    def error(self, message: str) -> NoReturn:
        """Print the usage and a shortened error message, and exit with code 2."""
        # argparse's message about an unknown subcommand, with the list of the known ones
        unknown = re.fullmatch(
            r"argument COMMAND: invalid choice: '(.*)' \(choose from (.*)\)", message
        )
        if unknown:
            name, commands = unknown.groups()
            message = f"{name} is not a command; {suggest(name, re.findall(r'[a-z]+', commands))}"
        super().error(shorten(message))


def add_command(
    commands: Any,
    name: str,
    run: Callable[[argparse.Namespace], int],
    *,
    summary: str,
    description: str,
    epilog: str,
) -> ArgumentParser:
    """Add a subcommand with its function, its help texts and the option ``-v``.

    Parameters
    ----------
    commands : argparse action
        The result of `argparse.ArgumentParser.add_subparsers`.
    name : str
        Name of the subcommand.
    run : callable
        Function that runs the subcommand with the parsed options and returns the exit code.
    summary : str
        One line about the subcommand in the list of commands.
    description : str
        Text above the options in the help of the subcommand.
    epilog : str
        Text below the options, with examples and exit codes.

    Returns
    -------
    ArgumentParser
        The parser of the subcommand. Its options contain `run`, the function, and `parser`, this
        parser.
    """
    parser: ArgumentParser = commands.add_parser(
        name, help=summary, description=description, epilog=epilog
    )
    parser.set_defaults(run=run, parser=parser)
    # a default would overwrite the count of a `-v` in front of the subcommand
    add_verbosity(parser, default=argparse.SUPPRESS)
    return parser


def add_scene_command(
    commands: Any,
    name: str,
    run: Callable[[argparse.Namespace], int],
    *,
    summary: str,
    description: str,
    epilog: str,
    json_help: str = "print one JSON object and nothing else",
) -> ArgumentParser:
    """Add a subcommand with a scene file, ``--set``, and optionally ``--json``.

    Parameters
    ----------
    commands, name, run, summary, description, epilog
        See `add_command`.
    json_help : str
        Help text of ``--json``. Empty for a subcommand without this option.

    Returns
    -------
    ArgumentParser
        The parser of the subcommand.
    """
    parser = add_command(
        commands, name, run, summary=summary, description=description, epilog=epilog
    )
    parser.add_argument("scene", metavar="SCENE.toml", help="scene file")
    parser.add_argument(
        "--set",
        metavar="KEY=VALUE",
        action="append",
        default=[],
        dest="settings",
        help="change a value of the scene, such as load.force_N=2 or electrodes[0].x_mm=9. VALUE "
        "is TOML; a bare word or path is text; a table, as in 'film={thickness_um=12}', changes "
        "only the keys in it. May be repeated; the last value of a key counts",
    )
    if json_help:
        parser.add_argument("--json", action="store_true", help=json_help)
    return parser


def add_verbosity(parser: argparse.ArgumentParser, default: Any = 0) -> None:
    """Add the option ``-v``, which may be repeated.

    Parameters
    ----------
    parser : argparse.ArgumentParser
        The parser to which the option is added.
    default : int or argparse.SUPPRESS
        Value of `options.verbose`, the number of ``-v``, if the option is not used.
    """
    parser.add_argument(
        "-v",
        "--verbose",
        action="count",
        default=default,
        help="log meshes, iterations and other steps on standard error; -vv logs more",
    )


def add_text_option(
    parser: Any, name: str, metavar: str, *, about: str, default: str | None = None
) -> None:
    """Add an option whose value remains a text.

    The subcommand parses it later, so that the errors of all options are reported together.

    Parameters
    ----------
    parser : argparse.ArgumentParser or argument group
        The parser to which the option is added.
    name, metavar : str
        The option, such as ``--sigma``, and the name of its value in the help.
    about : str
        Help text, to which the default is added.
    default : str, optional
        Text of the option if it is not used. Default: None.
    """
    text = about if default is None else f"{about} (default: {default})"
    parser.add_argument(name, metavar=metavar, default=default, help=text)


class NoiseOptions(NamedTuple):
    """Standard deviations of readings, as the options of `add_noise_options` give them."""

    sigma: float  #: As a fraction of the charge or change that is read.
    noise: float | None  #: Additional one of every reading; None for that of the readout.


def add_noise_options(
    parser: argparse.ArgumentParser, noise_option: str = "--noise", unit: str = "in its unit"
) -> None:
    """Add the option ``--sigma``, and another one for noise that does not depend on the reading.

    Parameters
    ----------
    parser : argparse.ArgumentParser
        The parser to which the options are added.
    noise_option : str
        The second option.
    unit : str
        Unit of its value, for the help.
    """
    add_text_option(
        parser,
        "--sigma",
        "FRACTION",
        about="standard deviation of a reading, relative to the charge or change that is read",
        default="0.01",
    )
    about = (
        f"additional standard deviation of every reading {unit} (default: readout.noise_V, or 0)"
    )
    add_text_option(parser, noise_option, "VALUE", about=about)


def parse_noise_options(
    options: argparse.Namespace, errors: list[str], noise_option: str = "--noise"
) -> NoiseOptions:
    """Parse the options of `add_noise_options`.

    Parameters
    ----------
    options : argparse.Namespace
        Options of the subcommand.
    errors : list of str
        Error messages, to which one is appended for each value that is invalid.
    noise_option : str
        The option of `add_noise_options`.
    """
    noise_text = getattr(options, noise_option.removeprefix("--").replace("-", "_"))
    sigma = parse_number("--sigma", options.sigma, errors, allow_zero=True)
    noise = parse_optional_number(noise_option, noise_text, errors, allow_zero=True)
    return NoiseOptions(sigma, noise)


def add_progress(parser: argparse.ArgumentParser) -> None:
    """Add the option ``--progress``, which is True, or None if it is not used."""
    parser.add_argument(
        "--progress",
        action="store_true",
        default=None,
        help="show finished work and remaining time even if standard error is not a terminal",
    )


def describe_unknown_argument(words: Sequence[str], parser: argparse.ArgumentParser) -> str:
    """Return an error message for arguments that a subcommand does not have.

    For a scene key that is used as an option, as in ``--force 2``, the message suggests ``--set``.
    For any other option it suggests the most similar one.

    Parameters
    ----------
    words : sequence of str
        Command-line arguments that the parser did not recognise.
    parser : argparse.ArgumentParser
        The parser of the subcommand.

    Returns
    -------
    str
        A message about the first of the arguments.
    """
    word = words[0]
    if not word.startswith("-"):
        return f"{word}: is one argument too many; remove it, or write --set KEY=VALUE"
    option, equals, value = word.partition("=")
    if not equals and len(words) > 1:
        value = words[1]
    # the name of a key with or without its unit: --force also stands for force_N
    key_with_unit = re.compile(rf"{re.escape(option.strip('-').replace('-', '_'))}(_\w+)?")
    for key in read_key_texts():
        is_in_list = key.table.startswith("[[")
        if key_with_unit.fullmatch(key.name) and not is_in_list:
            full_key = f"{key.table.strip('[]')}.{key.name}"
            return f"{word}: is not an option here; write --set {full_key}={value}"
    known = [name for action in parser._actions for name in action.option_strings]
    return f"{word}: is not an option here; {suggest(option, known)}"


# ------------------------------------------------------------------------------------- scenes


def read_scene(options: argparse.Namespace, *errors: str) -> Scene:
    """Read the scene file of a subcommand, and apply the changes of ``--set``.

    Keys of the file that the changed scene no longer has, although ``--set`` does not name them,
    are reported on standard error.

    Parameters
    ----------
    options : argparse.Namespace
        Options with `scene`, the path, and `settings`, the values of ``--set``.
    *errors : str
        Messages about other options, which are raised together with those about the scene.

    Returns
    -------
    Scene
        The changed scene.

    Raises
    ------
    InputError
        If there are messages in `errors`, or if the scene or its changes are invalid. The exception
        lists all messages.
    """
    from pvdf_fem.scene.scene import Scene

    messages = list(errors)
    changes = _parse_settings(options.settings, messages)
    try:
        original: Scene = Scene.from_file(options.scene)
        scene = original.with_(**changes) if changes else original
    except SceneError as error:
        messages += error.problems
    if messages:
        raise InputError(*messages)
    if changes:
        for lost in _find_lost_keys(original, scene, changes):
            print_errors(f"--set: removes {lost}, a key that the changed scene cannot have")
    return scene


def _parse_settings(settings: Sequence[str], errors: list[str]) -> dict[str, Any]:
    """Parse the texts ``KEY=VALUE`` of ``--set``, and return the values by normalized key.

    Several tables for one key are merged, otherwise the last value of a key counts. Messages about
    invalid texts are added to `errors`, and these texts are skipped.
    """
    from pvdf_fem.scene.changes import normalize_key

    changes: dict[str, Any] = {}
    for setting in settings:
        try:
            key, value = parse_change(setting)
            key = normalize_key(key)
        except SceneError as error:
            errors += [f"--set {problem}" for problem in error.problems]
            continue
        earlier = changes.get(key)
        if isinstance(value, dict) and isinstance(earlier, dict):
            value = earlier | value
        changes[key] = value
    return changes


def _find_lost_keys(original: Scene, scene: Scene, changes: Mapping[str, Any]) -> Iterator[str]:
    """Yield ``key = value`` of each key that disappeared because other keys were changed.

    Parameters
    ----------
    original : Scene
        The scene of the file.
    scene : Scene
        The changed scene.
    changes : mapping of str to value
        The new values by dotted key. Keys that `changes` itself names are not reported.
    """
    from pvdf_fem.scene.changes import find_changed_keys

    before = original.model_dump(mode="json", exclude_unset=True, exclude_none=True)
    after = scene.model_dump(mode="json", exclude_none=True)
    changed = find_changed_keys(changes)
    for name, section in before.items():
        old_tables = section if isinstance(section, list) else [section]
        new_section = after.get(name, {})
        new_tables = new_section if isinstance(new_section, list) else [new_section]
        # zip stops at the shorter list: tables that a change removed are not reported
        for old, new in zip(old_tables, new_tables, strict=False):
            for key, value in old.items():
                if key not in new and not changed & {name, f"{name}.{key}"}:
                    yield f"{name}.{key} = {quote(value)}"


# ------------------------------------------------------------------------------------- values


def read_number(text: str) -> float | None:
    """Parse a finite decimal number in ASCII, and return None for any other text."""
    # float() would also accept 1_000, and digits of other scripts
    if not re.fullmatch(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?", text):
        return None
    value = float(text)
    return value if math.isfinite(value) else None


def parse_number(option: str, text: str, errors: list[str], allow_zero: bool = False) -> float:
    """Parse the value of an option that must be a positive number, or also zero.

    Parameters
    ----------
    option : str
        The option, such as ``--sigma``, for the error message.
    text : str
        Its value on the command line.
    errors : list of str
        Error messages, to which one is appended if the value is invalid.
    allow_zero : bool
        Whether zero is also allowed.

    Returns
    -------
    float
        The number, or 0 if the value is invalid.
    """
    value = read_number(text)
    if value is None or value < 0.0 or (value == 0.0 and not allow_zero):
        allowed = "zero or a positive number" if allow_zero else "a positive number"
        errors.append(f"{option} {text[:MAX_QUOTED]}: must be {allowed}")
        return 0.0
    return value


def parse_optional_number(
    option: str, text: str | None, errors: list[str], allow_zero: bool = False
) -> float | None:
    """Parse the value of an option that has no default, and must be a positive number.

    Parameters
    ----------
    option, errors, allow_zero
        See `parse_number`.
    text : str, optional
        Value on the command line, or None if the option is not used.

    Returns
    -------
    float or None
        The number, 0 if the value is invalid, or None if the option is not used.
    """
    if text is None:
        return None
    return parse_number(option, text, errors, allow_zero)
