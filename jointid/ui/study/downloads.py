"""Files for other tools: results, tables, simulator snippets, and the study itself."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import streamlit as st

from jointid import Analysis, JointIdError, Study
from jointid.answer import without
from jointid.arrays import Floats
from jointid.exporting import (
    LANGUAGES,
    Identification,
    code_listing,
    gear_table,
    identification,
    mujoco_snippet,
    phasor_table,
    sdf_snippet,
    to_json,
    to_mat,
    to_toml,
    transfer_matrix_table,
    urdf_snippet,
)
from jointid.exporting.tables import without_friction_and_delay
from jointid.files.study_files import pack_study
from jointid.ui.shared.charts import choose_segment, download
from jointid.ui.shared.messages import show_error, show_info
from jointid.ui.shared.parse_numbers import numbers_in

_SNIPPETS = {
    "MuJoCo": (".xml", mujoco_snippet),
    "URDF": (".urdf", urdf_snippet),
    "SDF": (".sdf", sdf_snippet),
}


@dataclass(frozen=True, eq=False)
class Results:
    """The files of an analysis."""

    identification: Identification
    json: str
    toml: str
    phasors: str
    transfer: str
    """Only a header when the records allow no transfer matrix."""
    gears: str
    mat: bytes


@st.cache_resource(max_entries=64, show_spinner="Writing the files")
def results(digest: str, method: str, _analysis: Analysis) -> Results:
    """Write the files of an analysis."""
    found = identification(_analysis)
    return Results(
        identification=found,
        json=to_json(found),
        toml=to_toml(found),
        phasors=phasor_table(_analysis),
        transfer=transfer_matrix_table(_analysis),
        gears=gear_table(found),
        mat=to_mat(_analysis),
    )


def snippets(found: Identification, gear_ratio: Floats) -> dict[str, tuple[str, str]]:
    """Return each simulator's file ending and text, by the simulator's name."""
    return {name: (ending, write(found, gear_ratio)) for name, (ending, write) in _SNIPPETS.items()}


def show_identification_files(results: Results, stem: str) -> None:
    """Offer K, D and their origin as JSON, TOML and MATLAB."""
    st.subheader("K, D and how they were obtained", anchor=False)
    st.write(
        "With the state of the answer, covariance, friction, delay, and the inertias as given and as "
        "fitted. SI units, seen from the motors."
    )
    with st.container(horizontal=True):
        download("JSON", results.json, f"{stem}.json", "application/json")
        download("TOML", results.toml, f"{stem}.toml", "application/toml")
        download(
            "MATLAB (.mat)",
            results.mat,
            f"{stem}.mat",
            "application/octet-stream",
            hint="identification, model for ss(A, B, C, D), transfer for frd(H, omega), as measured and "
            "without friction and delay, and phasors.",
        )
    language = choose_segment("Copy K and D as", list(LANGUAGES), "copy_as")
    st.code(code_listing(results.identification, language), language=None)
    with st.expander("The whole file"):
        st.code(results.toml, language="toml", height=360)


def show_tables(results: Results, analysis: Analysis, stem: str) -> None:
    """Offer phasors and transfer matrix as CSV."""
    st.subheader("Tables", anchor=False)
    st.write(
        "CSV with a header line, every number with all its digits. H as measured"
        + (
            f", and in separate columns from torques {without(analysis.fit)}."
            if without_friction_and_delay(analysis)
            else "."
        )
    )
    with st.container(horizontal=True):
        if analysis.study.sine_records:
            download("Phasors (.csv)", results.phasors, f"{stem}_phasors.csv", "text/csv")
        download(
            "Gear laws (.csv)",
            results.gears,
            f"{stem}_gears.csv",
            "text/csv",
            hint="Torque over wind-up of every gear, motor side, up to the torque tried: for a 1-D "
            "Lookup Table in Simulink, a CombiTable1Ds in Modelica, or an own controller.",
        )
        if analysis.transfer_matrices:
            download("Transfer matrix H (.csv)", results.transfer, f"{stem}_H.csv", "text/csv")
    if not analysis.transfer_matrices:
        show_info(f"There is no table of H. {analysis.transfer_problem}")


def show_simulator_files(results: Results, n: int, stem: str) -> None:
    """Ask for the gear ratios and offer the joints as snippets for simulators."""
    st.subheader("For robot simulators", anchor=False)
    st.write(
        "Simulators see the joints from the arm. Through a gear ratio N, a stiffness K of the motor "
        "side becomes N²K; damping and rotor inertia likewise. These formats hold linear springs: a "
        "nonlinear gear is replaced by the secant of its torsion curve at the largest torque tried, "
        "which the file states."
    )
    entered = st.text_input(
        "Gear ratios, motor turns per joint turn" + (", one per joint" if n > 1 else ""),
        key="gears",
        bind="query-params",
        placeholder=", ".join(["100", "80", "60", "50", "50", "50"][:n]),
        help="Negative where the motor turns the other way than its joint. "
        "One number holds for all joints.",
    )
    if entered.strip():
        try:
            ratio = np.array(numbers_in("Gear ratios", entered, count=n))
            for tab, (name, (ending, text)) in zip(
                st.tabs(["MuJoCo", "URDF", "SDF"]),
                snippets(results.identification, ratio).items(),
                strict=True,
            ):
                with tab:
                    download(f"{name} ({ending})", text, f"{stem}{ending}", "application/xml")
                    st.code(text, language="xml", height=360)
        except JointIdError as error:
            show_error(error)
    else:
        st.caption("Without gear ratios there is no snippet: an error in a ratio counts by its square.")


def show_study_files(study: Study, stem: str) -> None:
    """Offer the study itself."""
    st.subheader("The study", anchor=False)
    st.write("study.toml and one table per record: readable without this software.")
    with st.container(horizontal=True):
        download(
            "Study, records as CSV (.zip)", lambda: pack_study(study), f"{stem}.zip", "application/zip"
        )
        download(
            "Study, records as Parquet (.zip)",
            lambda: pack_study(study, record_format="parquet"),
            f"{stem}_parquet.zip",
            "application/zip",
            hint="Reads faster.",
        )
