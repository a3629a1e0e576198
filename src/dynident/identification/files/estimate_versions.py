"""The versions of estimate files, and what each changed: one function a version, which the reader applies in turn."""

from __future__ import annotations

from dynident.file_versions import Document, FileVersions, renamed

#: Keys that version 2 has renamed, wherever ``summary`` holds figures; docs/json-output.md lists them.
SUMMARY_2 = {
    "joint_deviations": "residual_std",
    "train.joints[].rows": "samples",
    "train.moving.joints[].rows": "samples",
    "diagnostics.effective_rows": "effective_sample_size",
    "diagnostics.bias.reference": "instruments",
    "diagnostics.bias.degrees": "degrees_of_freedom",
    "diagnostics.bias": "errors_in_variables",
    "extras.cutoff_sensitivity.table[].held_out_error": "cross_validation_error",
    "extras.delays[].deviation": "std",
    "extras.friction_choice.joints.*[].held_out": "cross_validation_error",
    "extras.friction_choice.alike[].held_out": "cross_validation_error",
    "extras.friction_choice.alike": "shared",
    "extras.gain_deviations": "gain_std",
    "extras.held_out_fields": "chosen_fields",
    "extras.left_over": "whitened_correlation",
    "extras.stretches": "segments",
}

#: Figures of the findings of the log checks.
_NUMBERS_2 = {"certainty": "t", "deviation_kg": "std_kg", "deviation_s": "std_s"}


def _to_2(data: Document) -> Document:
    names = {f"summary.{place}": name for place, name in SUMMARY_2.items()}
    names |= {"train.joints[].rows": "samples", "train.moving[].rows": "samples", "train.deviations": "torque_std"}
    findings = "provenance.log_quality[].findings[].numbers"
    return renamed(data, names | {f"{findings}.{old}": new for old, new in _NUMBERS_2.items()})


#: Estimate files.
VERSIONS = FileVersions("an estimate", (_to_2,))
