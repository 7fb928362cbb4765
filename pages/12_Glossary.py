"""The terms of these pages, as in the documentation."""

import streamlit as st

from jointid.ui.shared.charts import glossary
from jointid.ui.shared.page import start

start("Glossary")
st.markdown(glossary())
