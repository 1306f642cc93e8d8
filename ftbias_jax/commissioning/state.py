"""What the steps of a calibration share, and where they have got to."""

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from types import MappingProxyType
from typing import NamedTuple

from ftbias_jax.calibration.identify_tool import IdentifyResult, identify_tool
from ftbias_jax.commissioning.judged import Judged
from ftbias_jax.commissioning.logs import longest
from ftbias_jax.commissioning.result import CHANNELS, TOOL, Step
from ftbias_jax.diagnosis.result import Diagnosis
from ftbias_jax.io.log import Log
from ftbias_jax.setup.types import Setup, ToolSetup
from ftbias_jax.types import Array


class Context(NamedTuple):
    """Logs and helpers that all steps of a calibration share."""

    whole: Sequence[Log]
    begun: Sequence[Log]
    """The logs without their held-out ends: causes are found in these, the tool in the longest."""
    names: Sequence[str]
    hold_out: float
    progress: Callable[[str], None]
    again: Callable[["State"], Setup | None]
    """Repeats, with the whole logs, the steps that were kept."""
    worker: ThreadPoolExecutor
    """Computes what is needed next if the step under evaluation is kept, or if nothing more is found."""
    mounting: bool = False
    """Whether the rotation of the sensor is identified with the tool: a delay, for example, looks like one."""

    def identify(self, setup: Setup, crosstalk: bool = False, translation: bool | None = None) -> IdentifyResult:
        """Identify the tool of a setup from the longest log."""
        log, mounting = longest(self.begun), self.mounting
        return identify_tool(
            setup, log, mounting=mounting, crosstalk=crosstalk, translation=translation, unchecked=True
        )

    def tool_ahead(self, setup: Setup, translation: bool | None = None) -> tuple[Setup, Future[IdentifyResult]]:
        """Start to identify the tool of a setup in the background."""
        return setup, self.worker.submit(self.identify, setup, translation=translation)


class State(NamedTuple):
    """The calibration after some steps."""

    setup: Setup
    judged: Judged
    steps: tuple[Step, ...]
    found: Diagnosis | None = None
    """The last diagnosis."""
    identified: ToolSetup | None = None
    """The tool of the first step with its standard errors, which causes may still change."""
    beside: Mapping[str, Array] = MappingProxyType({})
    """Standard errors of the tool when fitted together with the causes that were kept, by keys of [tool]: a tool
    identified with fixed causes is as uncertain as they are."""
    ahead: tuple[Setup, Future[IdentifyResult]] | None = None
    """A setup, and its tool that is being identified in the background."""

    @property
    def unmoved(self) -> ToolSetup | None:
        """The tool of the first step, if nothing has changed it since."""
        is_there = self.identified is not None and self.setup.tool.mass == self.identified.mass
        return self.identified if is_there else None

    @property
    def has_tool(self) -> bool:
        """Whether a tool was kept that was identified beside the causes."""
        return any(step.kept and step.kind in (TOOL, CHANNELS) for step in self.steps)
