"""EULUMDAT as a judge reads it: pyldt (eulumdat-py, MIT), and eulumdat-rs, an independent reader with a linter, as a foreign program."""

import eulumdat
import numpy as np
from pyldt import LdtReader

CANDELA_TOLERANCE = 1e-6  # of the peak: seven digits
FLUX_TOLERANCE = 1e-5  # six digits of each intensity


def judge_ldt(result, verdict):
    """Every file node by node against goniograms.json, by two readers; a file beside each IES file."""
    files = sorted(result.folder.glob("ies/*.ldt"))
    named = {part["files"].get("ldt") for _, part in result.parts() if "files" in part} - {None}
    verdict.that(named == {f"ies/{file.name}" for file in files}, "every EULUMDAT file is named in goniograms.json")
    verdict.that(len(files) == len(list(result.folder.glob("ies/*.ies"))), "there is an EULUMDAT file beside each IES file")
    for name, part in result.parts():
        path = part.get("files", {}).get("ldt")
        if path is None:
            continue
        values, lumens = np.array(part["luminous_intensity_cd"]), part["flux_lm"]
        ldt = LdtReader.read(result.folder / path)
        head = ldt.header
        verdict.that((head.mc, head.ng) == values.shape and head.isym == (1 if head.mc == 1 else 0), f"{path}: {head.mc} x {head.ng} nodes, Isym {head.isym}")
        verdict.that(np.allclose(head.c_angles, result.grid.c, atol=1e-5), f"{path}: its C planes are the JSON's")
        verdict.that(np.allclose(head.g_angles, result.grid.gamma, atol=1e-5), f"{path}: its gamma nodes are the JSON's")
        absolute = list(head.num_lamps) == [-1] and np.allclose(head.lamp_flux, lumens, rtol=FLUX_TOLERANCE)
        verdict.that(absolute, f"{path}: {head.num_lamps} lamps of {head.lamp_flux} lm, expected -1 of {lumens} lm")
        candela = np.array(ldt.intensities) * head.lamp_flux[0] / 1000
        off = np.abs(candela - values).max() / values.max()
        verdict.that(off <= CANDELA_TOLERANCE + 1e-5, f"{path}: {off:.2e} of the peak between EULUMDAT and JSON")
        verdict.close(float(result.grid.flux(candela)), lumens, FLUX_TOLERANCE, f"{path}: flux of its cells")
        other = eulumdat.Eulumdat.parse((result.folder / path).read_bytes().decode("latin-1"))
        verdict.close(other.max_intensity(), ldt_peak(ldt), 1e-6, f"{path}: largest intensity by eulumdat-rs")
        warned = [str(warning) for warning in other.validate()]
        verdict.that(not warned, f"{path}: eulumdat-rs warns: {warned[:3]}")
    print(f"eulumdat: {len(files)} files")


def ldt_peak(ldt):
    return float(np.array(ldt.intensities).max())
