"""An ensemble as an `xarray.Dataset`."""

from __future__ import annotations

from typing import Any

from sepv.errors import UsageError

# Axes before the paths, by name of an ensemble's arrays.
AXES: dict[str, tuple[str, ...]] = {
    "y": ("component",),
    "W": ("noise",),
    "status": (),
    "failed_step": (),
    "energy_defect": (),
    "casimir_defect": (),
    "states": ("time", "component"),
}


def to_xarray(ensemble: Any) -> Any:
    """The arrays of an `Ensemble` with dimensions path, time, component and noise, and what they are in `attrs`.

    Raises
    ------
    UsageError
        Without xarray, and for an ensemble whose paths were reduced.
    """
    try:
        import xarray
    except ImportError as error:
        raise UsageError(
            expected="xarray, for to_xarray()", received=f"{error}", remedy="pip install xarray"
        ) from error
    if ensemble.reduced and not ensemble.y.shape[-1]:
        raise UsageError(
            expected="an ensemble with its paths", received="one that was reduced: its paths are gone",
            remedy="Ensemble.reduced has its summaries; store= keeps the paths",
        )  # fmt: skip
    attrs = {k: v for k, v in ensemble.about.items() if isinstance(v, (str, int, float))}
    if hasattr(ensemble.y, "store_path"):
        # Still on disk, and read where it is looked at.
        kept = xarray.open_zarr(
            ensemble.y.store_path.store, consolidated=False, mask_and_scale=False, drop_variables=["work"]
        )
        data: dict[str, Any] = dict(kept.data_vars)
    else:
        data = {name: ((*axes, "path"), getattr(ensemble, name)) for name, axes in AXES.items()}
    attrs["engine"] = ensemble.engine
    if not len(ensemble.times):
        data.pop("states", None)
        return xarray.Dataset(data, attrs=attrs)
    return xarray.Dataset(data, coords={"time": ("time", ensemble.times)}, attrs=attrs)
