"""Records of a simulated robot with known K and D."""

import streamlit as st

from jointid import JointIdError
from jointid.ui.shared.messages import show_error
from jointid.ui.shared.method_steps import OVERVIEW
from jointid.ui.shared.page import start
from jointid.ui.shared.results import steps_at
from jointid.ui.shared.workspace import go_to, keep
from jointid.ui.study.simulation_form import ask, simulated_study

start(
    "Simulate a robot",
    "Define a robot and a closed-loop experiment, sines or another motion, with friction, noise and "
    "encoder steps. Its records become a study with known K and D.",
)
st.latex(
    r"""\begin{gathered}
    \mathbf M\ddot{\mathbf q} + \mathbf D(\dot{\mathbf q}-\dot{\mathbf q}_a)
    + \mathbf K(\mathbf q-\mathbf q_a) = \boldsymbol\tau \quad (5) \\
    \mathbf M_2\ddot{\mathbf q}_a + \mathbf D(\dot{\mathbf q}_a-\dot{\mathbf q})
    + \mathbf K(\mathbf q_a-\mathbf q) = \mathbf 0 \quad (6)
    \end{gathered}"""
)
try:
    simulation = ask()
    if simulation is not None:
        show = steps_at(st.progress(0.0, "Preparing"))
        st.button("Stop", help="Stops the simulation and discards it.")
        what = f"Simulating {simulation.records} records"
        study = simulated_study(simulation, lambda done: show(done, what))
        keep(study, "simulated")
        go_to(OVERVIEW)
except JointIdError as error:
    show_error(error)
