"""The stub of the compiled part has the names and the parameters that the compiled part has."""

import ast
import inspect

from conftest import REPOSITORY

from adjsplat import _native

STUB = ast.parse((REPOSITORY / "python" / "adjsplat" / "_native.pyi").read_text(encoding="utf-8"))


def public(thing):
    return {
        name: value
        for name, value in vars(thing).items()
        if not name.startswith("_") or name in ("__new__", "__version__")
    }


def stated(function):
    return [argument.arg for argument in function.args.args if argument.arg not in ("self", "cls")]


def compiled(function):
    return [name for name in inspect.signature(function).parameters if name != "self"]


def test_functions():
    stub = {node.name: stated(node) for node in STUB.body if isinstance(node, ast.FunctionDef)}
    here = {name: compiled(value) for name, value in public(_native).items() if inspect.isbuiltin(value)}
    assert here == stub and len(here) > 15


def test_classes():
    protocols = {"Look", "Place", "Reading", "Packing", "Step"}
    classes = {node.name: node for node in STUB.body if isinstance(node, ast.ClassDef) and node.name not in protocols}
    here = {name: value for name, value in public(_native).items() if inspect.isclass(value)}
    assert here.keys() == classes.keys()
    for name, node in classes.items():
        if issubclass(here[name], Exception):
            continue
        stub = {method.name: stated(method) for method in node.body if isinstance(method, ast.FunctionDef)}
        members = public(here[name])
        assert members.keys() - {"__new__"} == stub.keys() - {"__new__"}, name
        for method, parameters in stub.items():
            value = inspect.getattr_static(here[name], method)
            if method == "__new__" or inspect.isgetsetdescriptor(value):
                continue
            assert compiled(getattr(here[name], method)) == parameters, f"{name}.{method}"
