"""Any controller's log in, a study out: read tables, map columns, cut segments, make records."""

from jointid.importing.columns.log_table import LogColumn, LogTable, main_tables
from jointid.importing.find.segment import Segment
from jointid.importing.find.segments import common_frequencies, find_segments, measure_segment
from jointid.importing.map.guess import Guess, guess_mapping
from jointid.importing.map.mapped_log import MappedLog, apply_mapping
from jointid.importing.map.mapping import Channel, JointMapping, Mapping, TimeColumn
from jointid.importing.map.mapping_json import mapping_from_json, mapping_to_json
from jointid.importing.map.reasons import Reason
from jointid.importing.read.logs import read_log, read_logs
from jointid.importing.study import segment_records, study_from_logs

__all__ = [
    "Channel",
    "Guess",
    "JointMapping",
    "LogColumn",
    "LogTable",
    "MappedLog",
    "Mapping",
    "Reason",
    "Segment",
    "TimeColumn",
    "apply_mapping",
    "common_frequencies",
    "find_segments",
    "guess_mapping",
    "main_tables",
    "mapping_from_json",
    "mapping_to_json",
    "measure_segment",
    "read_log",
    "read_logs",
    "segment_records",
    "study_from_logs",
]
