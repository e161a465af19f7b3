# SPDX-License-Identifier: Apache-2.0
"""How the composites, decorators and leaves of py_trees are ticked, by plain calls."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from itertools import islice
from typing import Any

from py_trees import composites, decorators
from py_trees.behaviour import Behaviour
from py_trees.common import ParallelPolicy, Status

from bt_agents.engine.halting import (
    FAILURE,
    INVALID,
    RUNNING,
    SUCCESS,
    Step,
    Tree,
    own,
)
from bt_agents.engine.updates import update_of


def leaf(node: Behaviour, tree: Tree) -> Step:
    """As ``Behaviour.tick``."""
    initialise, terminate = own(node, "initialise"), own(node, "terminate")
    stop = None if type(node).stop is Behaviour.stop else tree.stops[node]
    acts = getattr(node, "acts", False)
    told, look = (None if acts else tree.told(node)), tree.look

    def step() -> Status:
        if initialise is not None and node.status is not RUNNING:
            initialise()
        status = node.update()
        if status is not RUNNING:
            if status is not SUCCESS and status is not FAILURE:
                status = _checked(status, node)
            if stop is not None:
                stop(status)
            elif terminate is not None:
                terminate(status)
        node.status = status
        if told is not None and (
            status is not told.status or node.feedback_message is not told.message
        ):
            look(node, told)
        return status

    return _telling_ends(step, node, tree) if acts else step


def decorator(node: Any, tree: Tree) -> Step:
    """As ``Decorator.tick``."""
    steps, stop = tree.steps, tree.stops[node]
    initialise, terminate = own(node, "initialise"), own(node, "terminate")
    update, noted = update_of(node), tree.noted
    told, look = tree.told(node), tree.look

    def step() -> Status:
        if initialise is not None and node.status is not RUNNING:
            initialise()
        child = node.decorated
        answered = steps[child]()
        if update is not None:
            status = update(node, child, answered)
        else:
            status = node.update()
            if child.status is not answered:
                # As Timeout does, the update has stopped it.
                noted.append(child)
        if status is not RUNNING:
            if status is not SUCCESS and status is not FAILURE:
                status = _checked(status, node)
            if terminate is not None or status is INVALID or child.status is RUNNING:
                stop(status)
        node.status = status
        if told is not None and (
            status is not told.status or node.feedback_message is not told.message
        ):
            look(node, told)
        return status

    return step


def guard(node: Any, tree: Tree) -> Step:
    """As ``EternalGuard.tick``."""
    let_through, stop, noted = decorator(node, tree), tree.stops[node], tree.noted
    told, look = tree.told(node), tree.look

    def step() -> Status:
        passed = node.condition()
        if isinstance(passed, Status):
            passed = passed is not FAILURE
        elif not isinstance(passed, bool):
            words = f"conditional check must return 'bool' or 'common.Status' [{type(passed)}]"
            node.logger.error(f"The {words}")
            raise RuntimeError(words)
        if passed:
            return let_through()
        stop(FAILURE)
        noted.append(node.decorated)
        if told is not None:
            look(node, told)
        return FAILURE

    return step


def one_shot(node: Any, tree: Tree) -> Step:
    """As ``OneShot.tick``."""
    shoot, bounce, noted = decorator(node, tree), leaf(node, tree), tree.noted

    def step() -> Status:
        if not node.final_status:
            return shoot()
        noted.append(node.decorated)
        return bounce()

    return step


def sequence(node: Any, tree: Tree) -> Step:
    """As ``Sequence.tick``."""
    steps, stops, stop, noted = tree.steps, tree.stops, tree.stops[node], tree.noted
    initialise, silent = own(node, "initialise"), tree.silent
    told, look = tree.told(node), tree.look

    def step() -> Status:
        children = node.children
        starts = node.status is not RUNNING
        rest = iter(children)
        status = SUCCESS
        if starts:
            node.current_child = children[0] if children else None
            for child in children:
                if child.status is not INVALID:
                    if child in silent:
                        child.status = INVALID
                    else:
                        stops[child](INVALID)
            if initialise is not None:
                initialise()
                rest = iter(node.children)
        elif node.memory and node.current_child is not None:
            child = node.current_child
            status = steps[child]()
            if status is RUNNING:
                return RUNNING
            if status is SUCCESS:
                rest = islice(children, children.index(child) + 1, None)
        if status is SUCCESS:
            for child in rest:
                node.current_child = child
                status = steps[child]()
                if status is not SUCCESS:
                    break
        if status is SUCCESS:
            if not node.children:
                node.current_child = None
            stop(SUCCESS)
        else:
            if not node.memory:
                for child in rest:
                    if child.status is not INVALID:
                        stops[child](INVALID)
                    elif not starts:
                        continue
                    noted.append(child)
            elif starts:
                noted.extend(rest)
            if status is RUNNING:
                node.status = RUNNING
            else:
                if status is INVALID:
                    noted.extend(children)
                stop(status)
        if told is not None and (
            status is not told.status or node.feedback_message is not told.message
        ):
            look(node, told)
        return status

    return step


def selector(node: Any, tree: Tree) -> Step:
    """As ``Selector.tick``."""
    steps, stops, stop, noted = tree.steps, tree.stops, tree.stops[node], tree.noted
    initialise = own(node, "initialise")
    told, look = tree.told(node), tree.look

    def step() -> Status:
        children = node.children
        starts = node.status is not RUNNING
        if starts:
            node.current_child = children[0] if children else None
            if initialise is not None:
                initialise()
                children = node.children
        previous = node.current_child
        rest = iter(children)
        if node.memory and children:
            assert previous is not None
            for child in islice(rest, children.index(previous)):
                if child.status is not INVALID:
                    stops[child](INVALID)
                    noted.append(child)
        for child in rest:
            status = steps[child]()
            if status is RUNNING or status is SUCCESS:
                node.current_child = child
                break
        else:
            status = FAILURE
        if status is FAILURE:
            stop(FAILURE)
            node.current_child = children[-1] if children else None
        else:
            if node.current_child is not previous:
                for child in rest:
                    if child.status is not INVALID:
                        stops[child](INVALID)
                    noted.append(child)
            elif starts:
                noted.extend(rest)
            if status is RUNNING:
                node.status = RUNNING
            else:
                stop(SUCCESS)
        if told is not None and (
            status is not told.status or node.feedback_message is not told.message
        ):
            look(node, told)
        return status

    return step


def parallel(node: Any, tree: Tree) -> Step:
    """As ``Parallel.tick``."""
    steps, stops, stop = tree.steps, tree.stops, tree.stops[node]
    initialise = own(node, "initialise")

    def step() -> Status:
        node.validate_policy_configuration()
        children = node.children
        if node.status is not RUNNING:
            for child in children:
                if child.status is not INVALID:
                    stops[child](INVALID)
            node.current_child = None
            if initialise is not None:
                initialise()
                children = node.children
        if not children:
            node.current_child = None
            stop(SUCCESS)
            return SUCCESS
        policy = node.policy
        for child in children:
            if not (policy.synchronise and child.status is SUCCESS):
                steps[child]()
        node.current_child = children[-1]
        status, node.current_child = _decided(policy, children)
        if status is not RUNNING:
            stop(status)
        node.status = status
        return status

    return telling(step, node, tree)


def _decided(policy: Any, children: list[Behaviour]) -> tuple[Status, Behaviour]:
    """Return how a parallel goes on, and the child that decides it."""
    for child in children:
        if child.status is FAILURE:
            return FAILURE, child
    if isinstance(policy, ParallelPolicy.SuccessOnAll):
        if all(child.status is SUCCESS for child in children):
            return SUCCESS, children[-1]
    elif isinstance(policy, ParallelPolicy.SuccessOnOne):
        for child in reversed(children):
            if child.status is SUCCESS:
                return SUCCESS, child
    elif isinstance(policy, ParallelPolicy.SuccessOnSelected):
        if all(child.status is SUCCESS for child in policy.children):
            return SUCCESS, policy.children[-1]
    else:
        raise RuntimeError(
            f"this parallel has been configured with an unrecognised policy [{type(policy)}]"
        )
    return RUNNING, children[-1]


STEPS: Mapping[object, tuple[Callable[[Any, Tree], Step], object]] = {
    Behaviour.tick: (leaf, Behaviour.stop),
    composites.Sequence.tick: (sequence, composites.Sequence.stop),
    composites.Selector.tick: (selector, composites.Selector.stop),
    composites.Parallel.tick: (parallel, composites.Parallel.stop),
    decorators.Decorator.tick: (decorator, decorators.Decorator.stop),
    decorators.EternalGuard.tick: (guard, decorators.Decorator.stop),
    decorators.OneShot.tick: (one_shot, decorators.Decorator.stop),
}
"""The ``tick`` of a class → what makes the same for a node, and the ``stop`` that goes with it."""


def telling(step: Step, node: Behaviour, tree: Tree) -> Step:
    """Return a step after which the node is told if it has changed."""
    told, look = tree.told(node), tree.look
    if told is None:
        return step

    def tell() -> Status:
        status = step()
        if status is not told.status or node.feedback_message is not told.message:
            look(node, told)
        return status

    return tell


def _telling_ends(step: Step, node: Behaviour, tree: Tree) -> Step:
    """Return a step after which the node is told if it has changed or ended."""
    told, look = tree.told(node), tree.look
    if told is None:
        return step

    def tell() -> Status:
        status = step()
        look(node, told, again=status is not RUNNING)
        return status

    return tell


def _checked(status: object, node: Behaviour) -> Status:
    """Return INVALID for what an update may not return, with a word in the log."""
    if status is not INVALID:
        node.logger.error(
            f"A behaviour returned an invalid status, setting to INVALID [{status}][{node.name}]"
        )
    return INVALID
