"""The terms of these pages, as in the documentation."""

from jointid.files.application import application_folder
from jointid.ui.shared.page import start

text = (application_folder() / "docs" / "reference" / "glossary.md").read_text("utf-8")
start("Glossary", text.partition("\n")[2])  # without its own heading
