"""Determines which cart a command means: that of --config, else of PROBEWATCH_CONFIG, else of this computer. Its
sockets and folders are derived from its configuration; options that name one of them take precedence.
"""

import os
import re
from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import Any, TypeVar, cast

import click
from click.core import ParameterSource

from probewatch.appliance.service.control.starting import UNIT_CONFIG, UNIT_SOCKET, NoService, how_to_start
from probewatch.appliance.supervision.languages import LANGUAGES
from probewatch.drivers.errors import ConfigurationError
from probewatch.drivers.files.markup import toml_of
from probewatch.drivers.files.regular_file import read_bounded

CONFIG = UNIT_CONFIG
SOCKET, LOG = UNIT_SOCKET, Path("/var/lib/probewatch")
ENVIRONMENT = "PROBEWATCH_CONFIG"
NAMED = "probewatch.named_cart"
"""Key in the context's meta for the configuration that was named; its value is None where none was."""
_CHOSEN = "probewatch.language"
"""Key for the language in which the command refuses, where its configuration is not that of the cart."""
_LANGUAGE = re.compile(rb'^[ \t]*(?:alarm\.)?language[ \t]*=[ \t]*"([a-z]{2})"', re.MULTILINE)
"""The line that states the language, for a file that is not valid TOML and whose mistakes are to be reported in it."""
_MOST_BYTES = 1_000_000
"""Bytes of a configuration at most; a usual one has some kB."""

_Command = TypeVar("_Command", bound=Callable[..., Any])


def config_option(command: _Command) -> _Command:
    """Adds --config, passed as config_file; None where neither it nor the environment names a cart."""
    return _config(expose=True)(command)


def file_argument(command: _Command) -> _Command:
    """Adds FILE, which --config and the environment may name too; passed as file."""
    file = click.argument("file", required=False, type=click.Path(path_type=Path), callback=_file)
    return file(_config(expose=False)(command))


def cart_option(command: _Command) -> _Command:
    """Adds --config to a command that requires it; passed as config_file."""
    return _config(expose=True, default=CONFIG)(command)


def socket_option(command: _Command) -> _Command:
    """Adds --config and --socket; the control socket of the service is passed as control_socket."""
    return _config(expose=False)(control_option(command))


def control_option(command: _Command) -> _Command:
    """Adds only --socket, for a command that has --config already."""
    option = click.option(
        "--socket",
        "control_socket",
        type=click.Path(path_type=Path),
        callback=_derived("control", "socket", SOCKET),
        help="control socket of the service [of its configuration]",
    )
    return option(saying_how_to_start(command))


def saying_how_to_start(command: _Command) -> _Command:
    """Makes the command state, where no service answers, how that of the named cart is started."""

    @wraps(command)
    def saying(*args: Any, **kwargs: Any) -> Any:
        try:
            return command(*args, **kwargs)
        except NoService as error:
            raise NoService(error.what, error.where, start_of(Path(error.where))) from None

    return cast(_Command, saying)


def required_config(told: str) -> Callable[[_Command], _Command]:
    """Adds --config to a command that reads the whole file; passed as config_file. told: its help."""
    return click.option(
        "--config",
        "config_file",
        required=True,
        envvar=ENVIRONMENT,
        show_envvar=True,
        type=click.Path(dir_okay=False, path_type=Path),
        callback=_remember,
        help=told,
    )


def folder_argument(command: _Command) -> _Command:
    """Adds --config and FOLDER; the folder of the alarm log is passed as folder."""
    return _config(expose=False)(click.argument("folder", required=False, **_FOLDER)(command))


def folder_option(command: _Command) -> _Command:
    """Adds --config and --folder; the folder of the alarm log is passed as folder."""
    told = "alarm log of the service [of its configuration]"
    return _config(expose=False)(click.option("--folder", help=told, **_FOLDER)(command))


def cart_says(section: str, key: str) -> Path | None:
    """Returns the path that the configuration of the command's cart states there, None where it states none. Raises
    ConfigurationError for a configuration that was named and cannot be read.
    """
    return _said(click.get_current_context().meta.get(NAMED), section, key)


def is_own_log(folder: Path) -> bool:
    """Returns whether it is the alarm log of the command's cart; any other may be a copy, or that of another cart."""
    return folder.resolve() == (cart_says("alarm", "folder") or LOG).resolve()


def cart_language() -> str:
    """Returns the language that was chosen, else that of the command's cart by its configuration, English where that
    states none.
    """
    if (chosen := click.get_current_context().meta.get(_CHOSEN)) is not None:
        return str(chosen)
    return language_in(click.get_current_context().meta.get(NAMED) or Path(os.environ.get(ENVIRONMENT) or CONFIG))


def speak(language: str) -> None:
    """Chooses the language in which the command refuses from now on."""
    click.get_current_context().meta[_CHOSEN] = language


def language_in(file: Path) -> str:
    """Returns the language of the cart by that configuration, English where that states none. A line with it is
    enough, also where another one is wrong.
    """
    try:
        content = read_bounded(file, _MOST_BYTES)
    except OSError:
        return "en"  # the code that needs the file reports what is wrong with it
    try:
        said = toml_of(content, _MOST_BYTES).get("alarm", {}).get("language")
    except (ValueError, AttributeError):
        line = _LANGUAGE.search(content)
        said = line and line[1].decode()
    return said if isinstance(said, str) and said in LANGUAGES else "en"


def start_of(control_socket: Path) -> str:
    """Returns how to start the service that should answer there, by the configuration of the command's cart if that
    names this socket.
    """
    context = click.get_current_context(silent=True)
    named = None if context is None else context.meta.get(NAMED)
    is_carts = (_said(named, "control", "socket") or SOCKET) == control_socket
    return how_to_start(control_socket, (named or CONFIG) if is_carts else None)


def named_or_own(config_file: Path | None, control_socket: Path | None) -> Path | None:
    """Returns the configuration that was named; where neither it nor a socket was, that of this computer, if any."""
    if config_file is not None or control_socket is not None:
        return config_file
    return CONFIG if CONFIG.is_file() else None


def _config(expose: bool, default: Path | None = None) -> Callable[[_Command], _Command]:
    return click.option(
        "--config",
        "config_file",
        type=click.Path(path_type=Path),
        default=default,
        envvar=ENVIRONMENT,
        show_envvar=True,
        is_eager=True,
        expose_value=expose,
        callback=_remember,
        help=f"configuration of the cart, from which all else is derived [{CONFIG}]",
    )


def _remember(context: click.Context, _: click.Parameter, value: Path | None) -> Path | None:
    context.meta[NAMED] = value
    return value


def _file(context: click.Context, _: click.Parameter, value: Path | None) -> Path:
    if value is not None and value.exists():
        context.meta[_CHOSEN] = language_in(value)
    return value or context.meta.get(NAMED) or CONFIG


def _derived(section: str, key: str, usual: Path) -> Callable[[click.Context, click.Parameter, Path | None], Path]:
    def derive(context: click.Context, _: click.Parameter, value: Path | None) -> Path:
        named = context.meta.get(NAMED)
        typed = context.get_parameter_source("config_file") is ParameterSource.COMMANDLINE
        if value is not None and not (named is not None and typed):
            return value
        said = _said(named, section, key)  # read even where it is not used: a typed file that does not exist is a slip
        return value or said or usual

    return derive


def _said(named: Path | None, section: str, key: str) -> Path | None:
    """Returns what the configuration states there, None where it states nothing; a running service is found even if
    another line is invalid. Raises ConfigurationError for a named file that cannot be read.
    """
    file = named or CONFIG
    try:
        said = toml_of(read_bounded(file, _MOST_BYTES), _MOST_BYTES).get(section, {}).get(key)
    except (OSError, ValueError, AttributeError) as error:
        if named is None:
            return None
        if isinstance(error, PermissionError):
            remedy = "Ask an administrator for the right to read it, or run this as one who has it"
            raise ConfigurationError("cannot be read: permission denied", str(file), remedy) from None
        if isinstance(error, OSError):
            remedy = f"Name the cart's configuration, by --config or {ENVIRONMENT}, or leave both out for {CONFIG}"
            raise ConfigurationError(f"cannot be read: {error.strerror}", str(file), remedy) from None
        raise ConfigurationError(f"cannot be read: {error}", str(file), f"See: probewatch check {file}") from None
    return file.parent / said if isinstance(said, str) else None


_FOLDER: dict[str, Any] = {
    "type": click.Path(path_type=Path, file_okay=False),
    "callback": _derived("alarm", "folder", LOG),
}
