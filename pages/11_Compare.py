"""Two studies, or two estimators, side by side."""

from jointid.ui.shared.page import open_page
from jointid.ui.study.comparison import answer_of_second, choose_other, show_differences, show_models

page = open_page(
    "Compare",
    "The chosen study compared with another: before and after a gear is replaced, cold and warm, one "
    "robot and its neighbour, or two estimators on the same records.",
)
analysis = page.answer()
other = choose_other(page)
second = answer_of_second(other)
show_differences(page, analysis, other, second)
show_models(page, analysis, other, second)
