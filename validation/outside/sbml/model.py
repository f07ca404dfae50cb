"""A model of SBML as a `System`.

``v_ID`` is the value of a symbol, ``a_ID`` the amount of a species, ``f_ID`` a rate of change, and
``d_`` the derivative of a state.

An event waits between trigger and execution, however short, in a place: a state ``due``, the time
of execution, and a state ``w`` for each value from the time of the trigger. A guard per trigger
fills a place; a guard per trigger that is not persistent empties the places of its event. One guard
executes what is due, one event at a time, by priority; between two executions other guards fire.
A trigger that is true at the start fires in the first mode, without effect: with ``initialValue``
false its event waits in a place from the start.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import libsbml

import mems_impact as mi
from validation.outside.case import Refused
from validation.outside.sbml.formulas import FUNCTIONS, condition, logic, margin, number

__all__ = ["Model"]

STARTING, RUNNING = mi.modes("starting", "running")
FREE = "-1.0"  # of a place in which no event waits
QUANTITY = re.compile(r"(?<![\w.])[adfv]_\w+")
CONSTANT = re.compile(r"[-+.()\de ]*")
CONVERTERS = ("flatten comp", "expandFunctionDefinitions", "promoteLocalParameters")


@dataclass(frozen=True)
class Event:
    """An event: the `logic` of its trigger, its formulas, and values by the variables assigned."""

    trigger: Any
    persistent: bool
    starts_true: bool
    at_trigger: bool
    delay: str
    priority: str
    values: Mapping[str, str]

    @property
    def held(self) -> dict[int, str]:
        """Values from the time of the trigger, unless they are constants, by their number."""
        texts = enumerate(self.values.values()) if self.at_trigger else ()
        return {j: text for j, text in texts if not CONSTANT.fullmatch(text)}


class Model:
    """A model: definitions of quantities by states ``y.``, parameters ``p.`` and each other.

    Parameters
    ----------
    path : str
    places : mapping of int to int, optional
        Executions of an event that may wait at once, by the number of the event; 1 by default.

    Raises
    ------
    Refused
        If the model is not one of ordinary differential equations.
    """

    def __init__(self, path: str, places: Mapping[int, int]) -> None:
        self.document = _read(path)
        self.model = self.document.getModel()
        self.events = [
            _event(each)
            for each in self.model.getListOfEvents()
            if each.isSetTrigger() and each.getTrigger().isSetMath()
        ]
        self.places = [(i, k) for i in range(len(self.events)) for k in range(places.get(i, 1))]
        self.defined: dict[str, str] = {}
        self.start: dict[str, str] = {}  # initial values of states and parameters
        self.derivatives: dict[str, str] = {}  # of the states
        self.compartments: dict[str, str] = {}  # of the species that have a concentration
        self._read_rules()
        for each in self.model.getListOfCompartments():
            self._add(each.getId(), each.getSize() if each.isSetSize() else math.nan)
        for each in self.model.getListOfParameters():
            self._add(each.getId(), each.getValue() if each.isSetValue() else math.nan)
        effects = self._read_reactions()
        for each in self.model.getListOfSpecies():
            self._add_species(each, effects.get(each.getId(), []))
        for i, k in self.places:
            event = self.events[i]
            waits = k == 0 and not event.starts_true
            fires = condition(event.trigger) if waits else "False"
            self.start[f"due_{i}_{k}"] = f"({event.delay} if {fires} else {FREE})"
            for j, text in event.held.items():
                self.start[f"w_{i}_{k}_{j}"] = f"({text} if {fires} else 0.0)"
        # The seed of random choices, and the last event for which no place was free.
        self.start |= {"seed": "1.0", "lost": FREE}
        added = [name for name in self.start if not QUANTITY.match(name)]
        self.derivatives |= dict.fromkeys(added, "0.0")

    # --- Definitions

    def _read_rules(self) -> None:
        model = self.model
        rules = [each for each in model.getListOfRules() if each.isSetMath()]
        if any(each.isAlgebraic() for each in rules):
            raise Refused("algebraic rule")
        texts = {each.getVariable(): number(each.getMath()) for each in rules}
        self.assigned = {
            each.getVariable(): texts[each.getVariable()] for each in rules if each.isAssignment()
        }
        self.ruled = {name: text for name, text in texts.items() if name not in self.assigned}
        self.initial = {
            each.getSymbol(): number(each.getMath())
            for each in model.getListOfInitialAssignments()
            if each.isSetMath()
        }
        self.changed = set(self.ruled).union(*(event.values for event in self.events))

    def _add(self, symbol: str, value: float) -> None:
        """Add a parameter, a compartment or a stoichiometry."""
        name = f"v_{symbol}"
        if symbol in self.assigned:
            self.defined[name] = self.assigned[symbol]
            return
        self.start[name] = self.initial.get(symbol, _literal(value))
        self.defined[f"f_{symbol}"] = "0.0"
        if symbol in self.changed:
            self.derivatives[name] = self.ruled.get(symbol, "0.0")
            self.defined[f"f_{symbol}"] = f"d_{name}"

    def _add_species(self, species: Any, effects: list[str]) -> None:
        symbol, size = species.getId(), f"v_{species.getCompartment()}"
        compartment = self.model.getCompartment(species.getCompartment())
        is_point = compartment.isSetSpatialDimensions() and compartment.getSpatialDimensions() == 0
        value, amount, rate = f"v_{symbol}", f"a_{symbol}", f"f_{symbol}"
        has_amount = species.getHasOnlySubstanceUnits() or is_point
        by_size, per_size = ("", "") if has_amount else (f" * {size}", f" / {size}")
        if not has_amount:
            self.compartments[symbol] = species.getCompartment()
        if symbol in self.assigned:
            self.defined |= {value: self.assigned[symbol], amount: value + by_size}
            return
        self.defined[value] = amount + per_size
        if symbol in self.initial:
            self.start[amount] = self.initial[symbol] + by_size
        elif species.isSetInitialConcentration():
            self.start[amount] = f"{_literal(species.getInitialConcentration())} * {size}"
        else:
            self.start[amount] = _literal(
                species.getInitialAmount() if species.isSetInitialAmount() else math.nan
            )
        if species.getBoundaryCondition() or species.getConstant():
            effects = []
        if symbol in self.ruled:
            growth = "" if has_amount else f" + {value} * f_{species.getCompartment()}"
            self.derivatives[amount] = f"{self.ruled[symbol]}{by_size}{growth}"
        elif effects or symbol in self.changed:
            factor = species.getConversionFactor() or self.model.getConversionFactor()
            factor = f" * v_{factor}" if factor else ""
            self.derivatives[amount] = f"({' '.join(effects) or '0.0'}){factor}"
        change = f"d_{amount}" if amount in self.derivatives else "0.0"
        self.defined[rate] = change
        if not has_amount:
            self.defined[rate] = f"({change} - {value} * f_{species.getCompartment()}) / {size}"

    def _read_reactions(self) -> dict[str, list[str]]:
        """Return terms of the derivatives of species."""
        effects: dict[str, list[str]] = {}
        for reaction in self.model.getListOfReactions():
            if reaction.isSetFast() and reaction.getFast():
                raise Refused("fast reaction")
            law, name = reaction.getKineticLaw(), f"v_{reaction.getId()}"
            self.defined[name] = number(law.getMath()) if law and law.isSetMath() else "0.0"
            sides = {"-": reaction.getListOfReactants(), "+": reaction.getListOfProducts()}
            for sign, references in sides.items():
                for each in references:
                    factor = _literal(each.getStoichiometry())
                    if each.isSetStoichiometryMath():
                        factor = number(each.getStoichiometryMath().getMath())
                    elif each.isSetId():
                        self._add(each.getId(), each.getStoichiometry())
                        factor = f"v_{each.getId()}"
                    effects.setdefault(each.getSpecies(), []).append(f"{sign} {factor} * {name}")
        return effects

    # --- Functions

    def lines(self, *texts: str, known: Mapping[str, str]) -> list[str]:
        """Return the lines that define the quantities that texts need, in order."""
        found: dict[str, str] = {}

        def find(text: str, path: tuple[str, ...] = ()) -> None:
            for name in QUANTITY.findall(text):
                if name in path or name not in known:
                    kind = "circular definition" if name in path else "unknown quantity"
                    raise Refused(f"{kind}: {name}")
                if name not in found:
                    find(known[name], (*path, name))
                    found[name] = f"{name} = {known[name]}"

        for text in texts:
            find(text)
        return list(found.values())

    def initial_values(self) -> dict[str, float]:
        """Return the values of states and parameters at the start."""
        start = {name: text for name, text in self.start.items() if QUANTITY.match(name)}
        known = self.defined | start | self._derivatives()
        lines = self.lines(*self.start, *self.start.values(), known=known)
        places = [f"{name} = {text}" for name, text in self.start.items() if name not in known]
        space = {**FUNCTIONS, "math": math, "t": 0.0}
        exec("\n".join([*lines, *places]), space)
        return {name: float(space[name]) for name in self.start}

    def system(self, time_scale: float) -> mi.System:
        """Return the system; runs sample it ten times in a time scale."""
        values = self.initial_values()
        states = {name: values[name] for name in self.derivatives}
        parameters = {
            name: value
            for name, value in values.items()
            if name not in states and math.isfinite(value)
        }
        if not all(map(math.isfinite, states.values())):
            raise Refused("initial value infinite or missing")
        self.known = {
            **{name: _literal(value) for name, value in values.items()},
            **{name: f"y.{name}" for name in states},
            **{name: f"p.{name}" for name in parameters},
            **self._derivatives(),
            **self.defined,
        }
        flow = self._function("flow", f"return ({', '.join(self._derivatives())},)")
        guards = [guard for i, _ in enumerate(self.events) for guard in self._watch(i)]
        begin = self._function("begin", "return RUNNING, y")
        now = self._function("now", "return -1.0")
        guards.append(mi.Guard("start", now, begin, modes=(STARTING,), condition=True))
        due = self._function("due", *self._waiting())
        execute = self._function("execute", *self._execution())
        guards.append(mi.Guard("execute", due, execute, modes=(RUNNING,), condition=True))
        return mi.System(
            states=list(states),
            flow=flow,
            parameters=parameters,
            guards=guards,
            modes=[STARTING, RUNNING],
            initial=states,
            time_scale=time_scale,
        )

    def _derivatives(self) -> dict[str, str]:
        return {f"d_{name}": text for name, text in self.derivatives.items()}

    def output(self, names: list[str]) -> Any:
        """Return a function of time, state and parameters: the values of quantities."""
        return self._function("output", f"return ({', '.join(names)},)", arguments="t, y, p")

    def output_of(self, symbol: str, is_concentration: bool) -> str:
        """Return the text of the value in a table: of a species its amount or concentration."""
        species = self.model.getSpecies(symbol)
        if species is None:
            return f"v_{symbol}"
        return f"a_{symbol} / v_{species.getCompartment()}" if is_concentration else f"a_{symbol}"

    def _function(self, name: str, *texts: str, arguments: str = "mode, t, y, p") -> Any:
        space = {**FUNCTIONS, "math": math, "STARTING": STARTING, "RUNNING": RUNNING}
        lines = [*self.lines(*texts, known=self.known), *texts]
        exec("\n    ".join([f"def {name}({arguments}):", *lines]), space)
        return space[name]

    def _after(self, changes: Mapping[str, str]) -> str:
        """Return the text of mode and state after changes."""
        state = ", ".join(changes.get(name, f"y.{name}") for name in self.derivatives)
        return f"return mode, ({state},)"

    def _watch(self, i: int) -> list[mi.Guard]:
        """Return the guards of the trigger of an event."""
        event, places = self.events[i], [k for event, k in self.places if event == i]
        texts = [f"due = t + {event.delay}", *(f"w_{j} = {text}" for j, text in event.held.items())]
        true = condition(event.trigger)
        texts += [f"if mode == STARTING and {true}:", f"    {self._after({})}"]
        for k in places:
            filled = {f"due_{i}_{k}": "due", **{f"w_{i}_{k}_{j}": f"w_{j}" for j in event.held}}
            texts += [f"if y.due_{i}_{k} < 0.0:", f"    {self._after(filled)}"]
        fill = self._function("fill", *texts, self._after({"lost": f"{i}.0"}))
        text = margin(event.trigger, self._is_steady)
        trigger = self._function("trigger", f"return {text}")
        guards = [mi.Guard(f"trigger {i}", trigger, fill)]
        if not event.persistent:
            waits = " or ".join(f"y.due_{i}_{k} >= 0.0" for k in places)
            ceasing = self._function("ceasing", f"return -({text}) if {waits} else 1.0")
            empty = self._function("empty", self._after({f"due_{i}_{k}": FREE for k in places}))
            guards.append(mi.Guard(f"end of trigger {i}", ceasing, empty, condition=True))
        return guards

    def _is_steady(self, text: str) -> bool:
        """Return whether a quantity changes at events only."""
        lines = " ".join([*self.lines(text, known=self.known), text])
        states = re.findall(r"\by\.(\w+)", lines)
        moves = any(self.derivatives[name] != "0.0" for name in states)
        return not moves and re.search(r"(?<![\w.])t\b", lines) is None

    def _waiting(self) -> list[str]:
        """Return the lines of the time until an event is due; 1 if none waits."""
        places = [f"y.due_{i}_{k}" for i, k in self.places]
        texts = [f"wait = smaller(wait, {due} - t if {due} >= 0.0 else 1.0)" for due in places]
        return ["wait = 1.0", *texts, "return wait"]

    def _execution(self) -> list[str]:
        """Return the lines of the transition that executes the first event that is due."""
        texts = [
            "late = t + 1e-12 * (1.0 + t)",
            "chosen, first, ties, seed = -1, -math.inf, 0.0, y.seed",
        ]
        for n, (i, k) in enumerate(self.places):
            texts += [
                f"if 0.0 <= y.due_{i}_{k} <= late:",
                f"    priority = {self.events[i].priority}",
                "    if chosen < 0 or priority > first:",
                f"        chosen, first, ties = {n}, priority, 1.0",
                "    elif priority == first:",
                "        ties += 1.0",
                "        seed = (16807.0 * seed) % 2147483647.0",
                "        if seed % ties < 1.0:",
                f"            chosen = {n}",
            ]
        for n, (i, k) in enumerate(self.places):
            values, held = self.events[i].values, self.events[i].held
            after = {f"due_{i}_{k}": FREE, "seed": "seed"}
            for j, name in enumerate(values):
                size = f" * v_{self.compartments[name]}" if name in self.compartments else ""
                after[self.state_of(name)] = f"w_{j}{size}"
            texts.append(f"if chosen == {n}:")
            for j, text in enumerate(values.values()):
                texts.append(f"    w_{j} = {f'y.w_{i}_{k}_{j}' if j in held else text}")
            texts.append(f"    {self._after(after)}")
        return [*texts, self._after({})]

    def state_of(self, symbol: str) -> str:
        """Return the state of a symbol."""
        return f"a_{symbol}" if f"a_{symbol}" in self.derivatives else f"v_{symbol}"


def _read(path: str) -> Any:
    """Return the document: one model without submodels, functions and local parameters."""
    document = libsbml.readSBMLFromFile(path)
    if document.getModel() is None:
        raise Refused(f"not readable: {document.getError(0).getShortMessage()}")
    for name in CONVERTERS:
        properties = libsbml.ConversionProperties()
        properties.addOption(name, True)
        properties.addOption("performValidation", False)
        if name == "flatten comp" and document.getPlugin("comp") is None:
            continue
        if document.convert(properties) != libsbml.LIBSBML_OPERATION_SUCCESS:
            raise Refused(f"not converted: {name}")
    return document


def _event(event: Any) -> Event:
    trigger, level = event.getTrigger(), event.getLevel()
    delay, priority = event.getDelay(), event.getPriority() if level > 2 else None
    return Event(
        trigger=logic(trigger.getMath()),
        persistent=level < 3 or trigger.getPersistent(),
        starts_true=level < 3 or trigger.getInitialValue(),
        at_trigger=event.getUseValuesFromTriggerTime(),
        delay=number(delay.getMath()) if delay and delay.isSetMath() else "0.0",
        priority=number(priority.getMath()) if priority and priority.isSetMath() else "-math.inf",
        values={
            each.getVariable(): number(each.getMath())
            for each in event.getListOfEventAssignments()
            if each.isSetMath()
        },
    )


def _literal(value: float) -> str:
    """Return the text of a number."""
    return f"({value!r})" if math.isfinite(value) else f'float("{value}")'
