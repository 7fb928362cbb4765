"""Any controller's log in, a study out: read tables, map columns, cut segments, make records."""

from jointid.importing.guess import Guess, guess_mapping
from jointid.importing.log_study import segment_records, study_from_logs
from jointid.importing.mapped_log import MappedLog, apply_mapping
from jointid.importing.mapping import Channel, JointMapping, Mapping, TimeColumn
from jointid.importing.mapping_json import mapping_from_json, mapping_to_json
from jointid.importing.reading import read_log, read_logs
from jointid.importing.reasons import Reason
from jointid.importing.segment import Segment
from jointid.importing.segments import common_frequencies, find_segments, measure_segment
from jointid.importing.tables import LogColumn, LogTable, main_tables

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
