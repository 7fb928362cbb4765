"""The terms of these pages, as in the documentation."""

import streamlit as st

from jointid.files.application import application_folder
from jointid.ui.shared.page import start

start("Glossary")
page = application_folder() / "docs" / "reference" / "glossary.md"
title, _, terms = page.read_text("utf-8").partition("\n")
st.title(title.removeprefix("# "), anchor=False)
st.markdown(terms)
