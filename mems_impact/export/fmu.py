"""Functional mock-up units (FMU): model description, C sources and a binary, in one archive."""

from __future__ import annotations

import hashlib
import math
import os
import platform
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from importlib.resources import files
from pathlib import Path

from mems_impact._util.files import file_path, replacing
from mems_impact._util.formatting import escape, stem
from mems_impact._util.limits import UNLIMITED, Limits
from mems_impact._util.quantities import base_powers
from mems_impact._util.warning_scopes import warn
from mems_impact.errors import InvalidParameter
from mems_impact.export.model import ExportedModel
from mems_impact.export.model_source import (
    CONSTANT,
    EVENT_VARIABLES,
    INPUT,
    TOKEN,
    first_integer,
    kind_of_number,
    model_header,
)

VERSIONS = ("2.0", "3.0")
TEMPLATES = ("arithmetic.h", "runtime.h")
DATE = (1980, 1, 1, 0, 0, 0)  # of every file, so that equal models have equal bytes
DEFAULT_STOP = 100.0  # periods, or units of time of an autonomous system
COMPILERS = ("cc", "gcc", "clang")
COMPILER_SECONDS = 600  # after which a compiler is ended
FLAGS = ("-O2", "-std=c11", "-fPIC", "-shared", "-ffp-contract=off", "-fvisibility=hidden")

# --- Variables


@dataclass(frozen=True, kw_only=True)
class ModelVariable:
    """A variable of the model description."""

    name: str
    reference: int
    causality: str
    variability: str
    initial: str = ""
    start: float | None = None
    unit: str = ""
    description: str = ""
    integer: bool = False
    state: int | None = None  # reference of the state, for a derivative
    indicator: bool = False  # whether it is an event indicator
    limits: Limits = UNLIMITED

    @property
    def range(self) -> dict[str, float]:
        """The attributes of the range."""
        bounds = {"min": self.limits.low, "max": self.limits.high}
        return {name: float(bound) for name, bound in bounds.items() if math.isfinite(bound)}


def identifier(name: str) -> str:
    """Return a name as an identifier."""
    result = re.sub(r"\W", "_", name, flags=re.ASCII)
    return result if result and not result[0].isdigit() else f"_{result}"


def rate_unit(unit: str, time: str) -> str:
    """Return the unit of a time derivative."""
    if not time:
        return ""
    if unit.endswith(f"/{time}"):
        return f"{unit}^2"
    return f"{unit}/{time}" if unit else f"1/{time}"


def model_variables(model: ExportedModel) -> list[ModelVariable]:
    """Return all variables, in the order of their references."""
    automaton = model.automaton
    n, m = len(automaton.states), len(automaton.guards)
    variables = [
        ModelVariable(
            name="time",
            reference=0,
            causality="independent",
            variability="continuous",
            unit=model.time_unit,
        )
    ]
    initial_values = [
        float(value) * factor
        for value, factor in zip(model.initial.y, model.state_factors, strict=True)
    ]
    for i, state in enumerate(automaton.states):
        variables.append(
            ModelVariable(
                name=state,
                reference=1 + i,
                causality="output",
                variability="continuous",
                initial="exact",
                start=initial_values[i],
                unit=model.state_units[i],
            )
        )
    for i, state in enumerate(automaton.states):
        variables.append(
            ModelVariable(
                name=f"der({state})",
                reference=1 + n + i,
                causality="local",
                variability="continuous",
                initial="calculated",
                unit=rate_unit(model.state_units[i], model.time_unit),
                state=1 + i,
            )
        )
    for i, number in enumerate(model.numbers):
        kind = kind_of_number(model, i)
        causality = {CONSTANT: "local", INPUT: "input"}.get(kind, "parameter")
        variability = {CONSTANT: "constant", INPUT: "continuous"}.get(kind, "fixed")
        variables.append(
            ModelVariable(
                name=number.name,
                reference=1 + 2 * n + i,
                causality=causality,
                variability=variability,
                initial="" if kind == INPUT else "exact",
                start=number.value,
                unit=number.unit,
                limits=number.limits,
            )
        )
    reference = 1 + 2 * n + len(model.numbers)
    guard_names = [identifier(guard.name) for guard in automaton.guards]
    for offset, quantity in ((0, "margin"), (m, "margin_rate")):
        for i, guard in enumerate(automaton.guards):
            if offset and not guard.impact:
                continue
            variables.append(
                ModelVariable(
                    name=f"{guard_names[i]}.{quantity}",
                    reference=reference + offset + i,
                    causality="local",
                    variability="continuous",
                    initial="calculated",
                    description="event indicator, in the units of the numerics",
                    indicator=True,
                )
            )
    variables.append(
        ModelVariable(
            name="event_time",
            reference=reference + 2 * m,
            causality="output",
            variability="discrete",
            initial="calculated",
            unit=model.time_unit,
            description="time of the latest event",
        )
    )
    for i in range(m):
        variables.append(
            ModelVariable(
                name=f"{guard_names[i]}.time",
                reference=reference + 2 * m + 1 + i,
                causality="output",
                variability="discrete",
                initial="calculated",
                unit=model.time_unit,
                description=f"time of the latest transition of {automaton.guards[i].name}",
            )
        )
    modes = ", ".join(f"{i}: {name}" for i, name in enumerate(automaton.modes))
    names = ", ".join(f"{i}: {guard.name}" for i, guard in enumerate(automaton.guards, 1))
    integers = (
        ("mode", f"mode ({modes})", int(model.initial.mode)),
        ("event_count", "number of events", None),
        ("event_kind", "latest event (1: transition, 2: end of chatter, 3: switch)", None),
        ("event_guard", f"guard of the latest event (0: none, {names})", None),
    )
    assert len(integers) == EVENT_VARIABLES
    integer_reference = first_integer(model)
    for i, (name, description, start) in enumerate(integers):
        variables.append(
            ModelVariable(
                name=name,
                reference=integer_reference + i,
                causality="output",
                variability="discrete",
                initial="calculated" if start is None else "exact",
                start=start,
                description=description,
                integer=True,
            )
        )
    for i, guard in enumerate(automaton.guards):
        variables.append(
            ModelVariable(
                name=f"{guard_names[i]}.count",
                reference=integer_reference + EVENT_VARIABLES + i,
                causality="output",
                variability="discrete",
                initial="calculated",
                description=f"number of transitions of {guard.name}",
                integer=True,
            )
        )
    return with_unique_names(variables)


def with_unique_names(variables: Iterable[ModelVariable]) -> list[ModelVariable]:
    """Return variables with names that differ: a later one gets underscores."""
    names: set[str] = set()
    result = []
    for variable in variables:
        name = variable.name
        while name in names:
            name += "_"
        names.add(name)
        result.append(variable if name == variable.name else replace(variable, name=name))
    return result


# --- Model description


def base_unit(unit: str) -> str:
    """Return the element BaseUnit of a unit in SI; empty for another unit."""
    try:
        powers = {"s": -1} if unit == "Hz" else base_powers(unit)
    except KeyError:
        return ""
    return f"<BaseUnit {attributes(**powers)}/>"


def attributes(**values: object) -> str:
    """Return XML attributes; empty ones are omitted."""
    parts = []
    for name, value in values.items():
        if value is None or value == "":
            continue
        text = str(value).lower() if isinstance(value, bool) else value
        text = repr(text) if isinstance(text, float) else str(text)
        parts.append(f'{name}="{escape(text)}"')
    return " ".join(parts)


def unit_lines(variables: Sequence[ModelVariable]) -> list[str]:
    """Return the definitions of all units."""
    units = sorted({variable.unit for variable in variables if variable.unit})
    if not units:
        return []
    lines = ["  <UnitDefinitions>"]
    for unit in units:
        lines.append(f"    <Unit {attributes(name=unit)}>{base_unit(unit)}</Unit>")
    return [*lines, "  </UnitDefinitions>"]


def experiment(model: ExportedModel) -> str:
    """Return the default experiment."""
    unit = model.problem.period * model.time_factor
    stop = model.start_time + DEFAULT_STOP * unit
    text = attributes(
        startTime=model.start_time, stopTime=stop, tolerance=model.problem.options.rtol
    )
    return f"  <DefaultExperiment {text}/>"


def description_2(
    model: ExportedModel, variables: Sequence[ModelVariable], token: str, name: str, title: str
) -> str:
    """Return ``modelDescription.xml`` of FMI 2.0."""
    guards = model.automaton.guards
    indicators = len(guards) + sum(guard.impact for guard in guards)
    capabilities = attributes(
        modelIdentifier=name, canGetAndSetFMUstate=True, canSerializeFMUstate=True
    )
    sources = "<SourceFiles><File name='fmi2.c'/></SourceFiles>"
    lines = [
        "<?xml version='1.0' encoding='UTF-8'?>",
        "<fmiModelDescription fmiVersion='2.0' "
        + attributes(
            modelName=title,
            guid=token,
            generationTool="mems_impact",
            variableNamingConvention="flat",
            numberOfEventIndicators=indicators,
        )
        + ">",
        f"  <ModelExchange {capabilities}>{sources}</ModelExchange>",
        f"  <CoSimulation {capabilities} canHandleVariableCommunicationStepSize='true' "
        f"maxOutputDerivativeOrder='1'>{sources}</CoSimulation>",
        *unit_lines(variables),
        experiment(model),
        "  <ModelVariables>",
    ]
    indices = {variable.reference: i for i, variable in enumerate(variables, 1)}
    for variable in variables:
        variable_attributes = attributes(
            name=variable.name,
            valueReference=variable.reference,
            causality=variable.causality,
            variability=variable.variability,
            initial=variable.initial,
            description=variable.description,
        )
        if variable.integer:
            element = f"<Integer {attributes(start=variable.start)}/>"
        else:
            state = None if variable.state is None else indices[variable.state]
            element = attributes(
                start=variable.start, unit=variable.unit, derivative=state, **variable.range
            )
            element = f"<Real {element}/>"
        lines.append(f"    <ScalarVariable {variable_attributes}>{element}</ScalarVariable>")
    lines += ["  </ModelVariables>", "  <ModelStructure>", "    <Outputs>"]
    outputs = [each for each in variables if each.causality == "output"]
    rates = [each for each in variables if each.state is not None]
    unknowns = [each for each in outputs if each.initial == "calculated"] + rates
    lines += [f"      <Unknown index='{indices[each.reference]}'/>" for each in outputs]
    lines += ["    </Outputs>", "    <Derivatives>"]
    lines += [f"      <Unknown index='{indices[each.reference]}'/>" for each in rates]
    lines += ["    </Derivatives>", "    <InitialUnknowns>"]
    unknown_indices = sorted(indices[each.reference] for each in unknowns)
    lines += [f"      <Unknown index='{index}'/>" for index in unknown_indices]
    lines += ["    </InitialUnknowns>", "  </ModelStructure>", "</fmiModelDescription>", ""]
    return "\n".join(lines)


def description_3(
    model: ExportedModel, variables: Sequence[ModelVariable], token: str, name: str, title: str
) -> str:
    """Return ``modelDescription.xml`` of FMI 3.0."""
    capabilities = attributes(
        modelIdentifier=name, canGetAndSetFMUState=True, canSerializeFMUState=True
    )
    lines = [
        "<?xml version='1.0' encoding='UTF-8'?>",
        "<fmiModelDescription fmiVersion='3.0' "
        + attributes(
            modelName=title,
            instantiationToken=token,
            generationTool="mems_impact",
            variableNamingConvention="flat",
        )
        + ">",
        f"  <ModelExchange {capabilities} needsCompletedIntegratorStep='true'/>",
        f"  <CoSimulation {capabilities} canHandleVariableCommunicationStepSize='true' "
        "maxOutputDerivativeOrder='1' hasEventMode='true' mightReturnEarlyFromDoStep='true'/>",
        *unit_lines(variables),
        experiment(model),
        "  <ModelVariables>",
    ]
    for variable in variables:
        kind = "Int32" if variable.integer else "Float64"
        text = attributes(
            name=variable.name,
            valueReference=variable.reference,
            description=variable.description,
            causality=variable.causality,
            variability=variable.variability,
            initial=variable.initial,
            unit=variable.unit,
            derivative=variable.state,
            start=variable.start,
            **variable.range,
        )
        lines.append(f"    <{kind} {text}/>")
    lines += ["  </ModelVariables>", "  <ModelStructure>"]
    outputs = [each for each in variables if each.causality == "output"]
    rates = [each for each in variables if each.state is not None]
    unknowns = [each for each in outputs if each.initial == "calculated"] + rates
    margins = [each for each in variables if each.indicator]
    for element, members in (
        ("Output", outputs),
        ("ContinuousStateDerivative", rates),
        ("InitialUnknown", unknowns),
        ("EventIndicator", margins),
    ):
        lines += [f"    <{element} valueReference='{each.reference}'/>" for each in members]
    lines += ["  </ModelStructure>", "</fmiModelDescription>", ""]
    return "\n".join(lines)


def build_description(name: str) -> str:
    """Return ``buildDescription.xml`` of FMI 3.0."""
    return "\n".join(
        [
            "<?xml version='1.0' encoding='UTF-8'?>",
            "<fmiBuildDescription fmiVersion='3.0'>",
            f"  <BuildConfiguration modelIdentifier='{name}'>",
            "    <SourceFileSet language='C11'>",
            "      <SourceFile name='fmi3.c'/>",
            "    </SourceFileSet>",
            "  </BuildConfiguration>",
            "</fmiBuildDescription>",
            "",
        ]
    )


# --- Binary


def find_compiler() -> list[str]:
    """Return the command of a C compiler: the variable CC, or cc; empty without a compiler."""
    command = os.environ.get("CC", "")
    if command:
        return shlex.split(command)
    compiler = next((each for each in COMPILERS if shutil.which(each)), None)
    return [compiler] if compiler else []


def binary_path(fmi: str, name: str) -> str:
    """Return the path in the archive of the binary for this platform."""
    system = {"linux": "linux", "win32": "windows", "darwin": "darwin"}.get(sys.platform, "linux")
    suffix = {"windows": "dll", "darwin": "dylib"}.get(system, "so")
    machine = platform.machine().lower()
    machine = {"amd64": "x86_64", "arm64": "aarch64"}.get(machine, machine)
    if fmi == "3.0":
        return f"binaries/{machine}-{system}/{name}.{suffix}"
    system_prefix = {"windows": "win", "darwin": "darwin"}.get(system, "linux")
    if machine == "x86_64":
        return f"binaries/{system_prefix}64/{name}.{suffix}"
    return f"binaries/{system_prefix}64-{machine}/{name}.{suffix}"


def compile_binary(sources: dict[str, str], main: str) -> tuple[bytes, str]:
    """Return the compiled library; empty, with the reason, if that is impossible."""
    compiler = find_compiler()
    if not compiler:
        return b"", "no C compiler was found (cc, or the environment variable CC)"
    try:
        with tempfile.TemporaryDirectory() as folder:
            for name, content in sources.items():
                Path(folder, name).write_text(content, encoding="utf-8")
            return compile_in(folder, compiler, main)
    except OSError as error:
        return b"", f"temporary files of the compiler cannot be written ({error.strerror or error})"


def compile_in(folder: str, compiler: Sequence[str], main: str) -> tuple[bytes, str]:
    """Return the library compiled from the sources in a folder; empty, with the reason, if none."""
    command = [*compiler, *FLAGS, main, "-o", "model", "-lm"]
    try:
        process = subprocess.run(
            command, cwd=folder, capture_output=True, text=True, check=False,
            timeout=COMPILER_SECONDS,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        return b"", f"{shlex.join(compiler)} did not end within {COMPILER_SECONDS} s"
    except OSError as error:
        return b"", f"{shlex.join(compiler)} cannot be run ({error.strerror})"
    if process.returncode != 0:
        message = next((line for line in process.stderr.splitlines() if "error" in line), "")
        return b"", f"{shlex.join(compiler)} failed: {message.strip()}"
    return Path(folder, "model").read_bytes(), ""


# --- Archive


def write_fmu(path: str | os.PathLike[str], model: ExportedModel, fmi: str = "3.0") -> Path:
    """Write a model as an FMU of version `fmi` of the standard, "2.0" or "3.0".

    Raises InvalidParameter if the version or an input is unknown, FunctionError if a function
    cannot be translated to C.
    """
    if fmi not in VERSIONS:
        raise InvalidParameter("fmi", fmi, f"one of {', '.join(VERSIONS)}")
    target = Path(file_path(path))
    name = identifier(target.stem)
    title = model.name or stem(target)
    main = "fmi3.c" if fmi == "3.0" else "fmi2.c"
    folder = files("mems_impact.export") / "templates"
    sources = {file: (folder / file).read_text(encoding="utf-8") for file in (*TEMPLATES, main)}
    variables = model_variables(model)
    describe = description_3 if fmi == "3.0" else description_2
    digest = hashlib.sha256()
    header = model_header(model)
    for content in (*sources.values(), header, describe(model, variables, "", name, title)):
        digest.update(content.encode() + b"\0")
    code = digest.hexdigest()
    token = "{" + "-".join((code[:8], code[8:12], code[12:16], code[16:20], code[20:32])) + "}"
    sources["model.h"] = header.replace(TOKEN, token)
    contents: dict[str, bytes] = {
        "modelDescription.xml": describe(model, variables, token, name, title).encode()
    }
    if fmi == "3.0":
        contents["sources/buildDescription.xml"] = build_description(name).encode()
    contents |= {f"sources/{file}": content.encode() for file, content in sorted(sources.items())}
    binary, reason = compile_binary(sources, main)
    if binary:
        contents[binary_path(fmi, name)] = binary
    else:
        message = (
            f"{target.name} contains C sources without a binary: {reason}; "
            "an importer has to compile them"
        )
        warn(message, UserWarning)
    with replacing(target) as temporary, zipfile.ZipFile(temporary, "w") as archive:
        for member, data in contents.items():
            entry = zipfile.ZipInfo(member, DATE)
            entry.compress_type = zipfile.ZIP_DEFLATED
            entry.external_attr = (0o755 if member.startswith("binaries/") else 0o644) << 16
            archive.writestr(entry, data)
    return target
