"""Machine code in numba's cache, and how it is loaded without what the compiler alone needs of it.

numba's own loader reads the code of a function in the compiler's form, too, lists its symbols, and imports the modules
of all functions that were compiled into it. That takes 0.3 s of a companion's warm start, and 20 MB.
"""

from typing import Any

from numba.core.caching import CompileResultCacheImpl
from numba.core.codegen import JITCodeLibrary, ll
from numba.core.compiler import CompileResult
from numba.core.environment import Environment, lookup_environment


class MachineCode(CompileResultCacheImpl):  # type: ignore[misc]
    """What of a compiled function goes to its file, and comes back."""

    def reduce(self, result: Any) -> Any:
        """The function's parts, as they are pickled."""
        (name, _, (code, bitcode)), *parts, environments = super().reduce(result)
        module = result.library._get_module_for_linking()
        defined = {each.name for each in (*module.functions, *module.global_variables) if not each.is_declaration}
        inner = [(each.env_name, each.globals["__name__"], each.consts) for each in environments]
        return (name, code, bitcode, defined), *parts, inner

    def rebuild(self, target_context: Any, payload: Any) -> Any:
        """The compiled function, ready to be called."""
        library, function, environment, signature, objectmode, lifted, annotation, initialize, inner = payload
        for each in initialize:
            each()
        loaded = _Loaded(target_context.codegen(), *library)
        entry_point = target_context.get_executable(loaded, function, environment)
        environments = [_environment(*each) for each in inner]
        for each in environments:
            loaded.codegen.set_env(each.env_name, each)
        return CompileResult(
            typing_context=target_context.typing_context,
            target_context=target_context,
            entry_point=entry_point,
            typing_error=None,
            type_annotation=annotation,
            signature=signature,
            objectmode=objectmode,
            lifted=lifted,
            fndesc=function,
            library=loaded,
            call_helper=None,
            environment=environment,
            metadata=None,
            reload_init=initialize,
            referenced_envs=environments,
        )


def _environment(name: str, module: str, constants: list[Any]) -> Any:
    """The constants of a function within a compiled one. Of its module it needs the name only."""
    environment = lookup_environment(name)
    if environment is None:
        environment = Environment({"__name__": module})
        environment.consts[:] = constants
        environment.env_name = name
        Environment._memo[name] = environment
    return environment


class _Loaded(JITCodeLibrary):  # type: ignore[misc]
    """A loaded library. A function that is compiled and calls it needs its bitcode."""

    def __init__(self, codegen: Any, name: str, code: bytes, bitcode: bytes, defined: set[str]) -> None:
        super().__init__(codegen, name)
        self._bitcode = bitcode
        self._shared_module: Any = None
        self.enable_object_caching()
        self._set_compiled_object(code)
        self._finalize_final_module()
        codegen._engine._defined_symbols |= defined

    def _get_module_for_linking(self) -> Any:
        if self._shared_module is None:
            self._shared_module = ll.parse_bitcode(self._bitcode)
        return self._shared_module
