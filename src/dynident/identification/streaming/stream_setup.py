"""What a stream of logs needs to know: the model, the meaning of the columns, and how they are prepared."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from dynident.data.formats import ColumnMap
from dynident.data.log import Log, measured_torque
from dynident.data.log_of_robot import with_meaning
from dynident.data.preprocessing import Preprocessing
from dynident.data.split import Split
from dynident.errors import LogMismatch
from dynident.identification.problem.problem import check_temperature
from dynident.identification.selection.friction.variable_projection import has_choices, has_varying
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import FRICTION


@dataclass(frozen=True)
class StreamSetup:
    """How logs are read as a stream, and become rows.

    Attributes:
        model: Robot, drives and friction.
        columns: How columns become signals.
        preprocessing: How logs become rows.
        locked: Positions of the joints that do not move, by name.
        case_path: The case file, for messages; empty where there is none.
        choose_friction: Whether friction is to be chosen from the logs, which a stream cannot.
        split: How each log is split; its training part is read. None: whole logs.
    """

    model: DynamicModel
    columns: ColumnMap
    preprocessing: Preprocessing
    locked: Mapping[str, float] = field(default_factory=dict)
    case_path: str = ""
    choose_friction: bool = False
    split: Split | None = None

    def check(self) -> None:
        """Refuse what needs all samples at once.

        Raises:
            LogMismatch: Friction that is chosen, varied or loaded.
        """
        place = self.case_path or "the case"
        state = f"find it on a part of the log, and state it in {place}"
        loaded, remembering = (
            ", ".join(FRICTION.name_of(part) for part in self.model.friction if name in part.needs)
            for name in ("torque", "state")
        )
        faults = [
            (evidence, step)
            for asked, evidence, step in (
                (self.choose_friction, "friction: auto needs all samples at once, which a stream does not have", state),
                (has_varying(self.model), "a friction part that varies a field (vary) needs all samples", state),
                (
                    has_choices(self.model),
                    "a friction part that leaves a field to the log (choose) needs all samples",
                    state,
                ),
                (
                    remembering,
                    "friction that remembers the way to a sample needs a whole log",
                    f"take {remembering} out of friction in {place}",
                ),
                (
                    loaded,
                    "friction that depends on the load takes several passes",
                    f"take {loaded} out of friction in {place}",
                ),
            )
            if asked
        ]
        if faults:
            evidence, steps = ("; ".join(dict.fromkeys(texts)) for texts in zip(*faults, strict=True))
            raise LogMismatch(self.case_path or "case", evidence, f"{steps}; or identify a part of the log in memory")

    def with_meaning(self, log: Log) -> Log:
        """Return rows as they were read with the joints of the robot and with torques.

        Raises:
            LogMismatch: A joint or a signal is missing, or a locked joint moves.
        """
        return with_meaning(log, self.columns, self.model.robot, self.locked)

    def check_signals(self, log: Log) -> None:
        """Refuse a log without the signals that the model needs.

        Raises:
            LogMismatch: The log has no torques, or no temperatures.
        """
        measured_torque(log)
        check_temperature(self.model, [log])
