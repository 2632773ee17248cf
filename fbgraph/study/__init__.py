"""The ForestBack paper's evaluation: trials in, its figures and table out, our estimators beside its own.

``trial`` and ``dataset`` read a data set, ``course`` simulates one; ``calibration`` fits as the paper does,
``protocol`` scores as it does, ``comparison`` tests; ``figures``, ``recording`` and ``report`` show; ``run`` puts it
all together.
"""
