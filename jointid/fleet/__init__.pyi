from .row import Row as Row
from .run import Limits as Limits
from .run import Progress as Progress
from .run import Summary as Summary
from .run import analyse_fleet as analyse_fleet
from .studies import find_studies as find_studies
from .table import read_fleet as read_fleet
