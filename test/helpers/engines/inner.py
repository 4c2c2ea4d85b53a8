"""The reference configuration, changed, with what no parameter sets: bounds and budgets.

Keys such as ``budget.least`` stand beside the parameters: ``bounds`` are those of the Gaussian
engine, ``budget`` those of the paper's particles, and ``spawning`` and ``memory`` those of the
models of spawning and of targets' own SNRs.
"""

from dataclasses import replace

import reference

from phd_jdtc_ros.core.models.amplitude_model import Memory

OF_CONFIG = ("bounds", "budget")
PREFIXES = (*OF_CONFIG, "spawning", "memory")


def resolve(given=None, *plane):
    """Return the configuration of parameters, with the keys of `PREFIXES` set as well."""
    own = {prefix: {} for prefix in PREFIXES}
    parameters = dict(given or {})
    for key in given or {}:
        prefix, _, name = key.partition(".")
        if prefix in own:
            own[prefix][name] = parameters.pop(key)
    config = reference.resolve(parameters, *plane)
    parts = {name: replace(getattr(config, name), **own[name]) for name in OF_CONFIG}
    model = replace(
        config.model,
        spawn=replace(config.model.spawn, **own["spawning"]),
        amplitudes=Memory(**own["memory"]) if own["memory"] else config.model.amplitudes,
    )
    return replace(config, model=model, **parts)
