"""All validators of usd-core on every file named: no errors. Prints what else they say."""
import sys
from pxr import Usd, UsdUtils, UsdValidation as V

registry = V.ValidationRegistry()
validators = registry.GetOrLoadAllValidators()
assert len(validators) > 20, len(validators)
bad = 0
for path in sys.argv[1:]:
    stage = Usd.Stage.Open(path)
    assert stage, path
    assert stage.GetDefaultPrim(), path
    errors = V.ValidationContext(validators).Validate(stage)
    for e in errors:
        sites = [str(s.GetPrim().GetPath()) if s.IsPrim() else str(s.GetProperty().GetPath()) if s.IsProperty() else "layer" for s in e.GetSites()]
        print(path, e.GetValidator().GetMetadata().name if e.GetValidator() else "", e.GetType(), e.GetMessage(), sites)
        bad += 1
    for layer in stage.GetUsedLayers():
        text = layer.ExportToString()
        assert text.startswith("#usda") or text.startswith("#sdf"), path
sys.exit(1 if bad else 0)
