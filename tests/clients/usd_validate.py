"""All validators of usd-core on every file named: no errors. Prints what else they say.

Every value of every layer is read, at all of its times: a damaged array or compressed block fails here.
"""
import sys
from pxr import Usd, UsdValidation as V

registry = V.ValidationRegistry()
validators = registry.GetOrLoadAllValidators()
assert len(validators) > 20, len(validators)
bad = 0


def read_values(layer):
    """Number of values that the attributes of a layer have."""
    count = 0

    def visit(path):
        nonlocal count
        spec = layer.GetAttributeAtPath(path) if path.IsPropertyPath() else None
        if spec is None:
            return
        if spec.HasDefaultValue():
            assert spec.default is not None, path
            count += 1
        for t in layer.ListTimeSamplesForPath(path):
            assert layer.QueryTimeSample(path, t) is not None, (path, t)
            count += 1

    layer.Traverse(layer.pseudoRoot.path, visit)
    return count


for path in sys.argv[1:]:
    stage = Usd.Stage.Open(path)
    assert stage, path
    assert stage.GetDefaultPrim(), path
    errors = V.ValidationContext(validators).Validate(stage)
    for e in errors:
        sites = [str(s.GetPrim().GetPath()) if s.IsPrim() else str(s.GetProperty().GetPath()) if s.IsProperty() else "layer" for s in e.GetSites()]
        print(path, e.GetValidator().GetMetadata().name if e.GetValidator() else "", e.GetType(), e.GetMessage(), sites)
        bad += 1
    assert sum(read_values(layer) for layer in stage.GetUsedLayers()) > 0, path
sys.exit(1 if bad else 0)
