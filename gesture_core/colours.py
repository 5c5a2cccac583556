"""What each colour means, in all pictures and pages: a palette told apart by people who see few colours."""

from __future__ import annotations

# Okabe and Ito (2008); they hold in print as well.
BLACK, BLUE, GREEN, VERMILLION, PURPLE = "#000000", "#0072b2", "#009e73", "#d55e00", "#cc79a7"
ORANGE, SKY, GREY, WHITE = "#e69f00", "#56b4e9", "#7f7f7f", "#ffffff"
GROUND = "#26282c"
"""Behind pictures."""
QUERY, ANSWER, RUNNER_UP, MATCH = BLACK, GREEN, PURPLE, GREY
"""The input, the class that won with its example, the second best with its own, matched frames."""
BY_MARGIN, BY_DISTANCE = VERMILLION, GREY
"""What a threshold is set on."""
RIGHT, LEFT, MIDDLE = ORANGE, SKY, WHITE
"""Sides of a person's body, theirs, not the picture's. No curve has the colour of a side."""
