"""Leads through a session without a page: arms trial after trial, judges each, and obeys commands meanwhile.

It decides only one thing that a page leaves to its operator: a recording without a reason to redo it is kept. The
journal is read anew before every step, so a decision that is made elsewhere, as by `station judge`, counts here too.
"""

from __future__ import annotations

import asyncio
import time
from typing import Protocol

from station.bench.simulation import SimulationError
from station.journal import Choice, JournalError, Recorded
from station.session.agenda import Agenda, order_of, redo_loses_migration
from station.session.desk import Desk
from station.session.judgement import Judgement
from station.session.live import Live
from station.session.open_session import CommandRefused
from station.session.trial_process import TrialProcess
from station.terminal.commands import MEANINGS, Action, Command, UnknownCommand
from station.terminal.events import (
    Answered,
    Decided,
    Event,
    NextTrial,
    SessionClosed,
    SessionOpened,
    Skipped,
    SummedUp,
    SummingUp,
    TrialEnded,
    VerdictGiven,
    Waiting,
    Warned,
)
from station.terminal.second_thoughts import NO_CUFF, WHY, SecondThoughts
from station.terminal.trial_watch import TrialWatch

POLL_S = 0.1
ELSEWHERE_S = 1.0
"""Wall seconds between two looks at the journal while a decision is waited for."""
FIRST_RETRY_S, LAST_RETRY_S = 2.0, 15.0
"""Wall seconds until a trial that could not be armed is tried again; they double."""
BETWEEN = ("arm", "redo", "redon", "undo", "skip", "finish", "end")
DECISIONS = ("keep", "redo", "redon", "skip", "pause", "end")

Request = Command | UnknownCommand


class Face(Protocol):
    """Shows a session to somebody. Must return at once."""

    def tell(self, event: Event) -> None: ...

    def show(self, live: Live | None) -> None:
        """The trial as it is now, several times a second; None while none runs."""
        ...


class Conductor:
    """One session on a desk, from where it stands to its end. requests are the operator's commands."""

    def __init__(
        self, desk: Desk, face: Face, requests: asyncio.Queue[Request], *, is_simulated: bool, waits_for_start: bool
    ) -> None:
        """waits_for_start: the station starts the captures itself, so a trial is armed only when the operator says."""
        self._desk, self._face, self._requests = desk, face, requests
        self._is_simulated, self._waits_for_start = is_simulated, waits_for_start
        self._is_paused = self._is_ended = self.is_complete = False
        self._is_started = False  # the operator has said that the next trial is to begin, where that is waited for
        self._redo: Command | None = None  # of the trial that runs
        self._retry_s = FIRST_RETRY_S
        self._recorded: set[str] = set()  # files of trials that were recorded here
        self._second_thoughts = SecondThoughts(desk)
        self._told: list[Event] = []  # that would only be repeated

    async def run(self) -> None:
        """Returns when the plan is complete and summed up, or the operator ends. Raises JournalError."""
        plan, setup = self._plan, self._desk.session.journal.setup
        assert setup is not None  # noqa: S101  (the desk has opened a session)
        counts = len(plan.trials), len(plan.done), len(plan.skipped)
        self._face.tell(
            SessionOpened(
                setup.subject, setup.number, str(self._desk.session.folder), *counts, is_simulated=self._is_simulated
            )
        )
        while not self._is_ended:
            await self._desk.reviewer.look_after()
            plan = self._plan
            if plan.undecided is not None and not self._is_left_to_others(plan.undecided):
                await self._decide(plan.undecided)
            elif plan.undecided is None and (plan.spec is None or self._desk.session.is_ending):
                self.is_complete = await self._sum_up()
                self._is_ended = self._is_ended or self.is_complete
            elif await self._may_arm(plan):
                await self._record()
        self._close()

    @property
    def has_summary(self) -> bool:
        return self._desk.session.summary is not None

    @property
    def _plan(self) -> Agenda:
        plan = self._desk.session.agenda
        assert plan is not None  # noqa: S101  (the desk has opened a session)
        return plan

    async def _command(self, within_s: float) -> Command | None:
        """The next command that can be one; None after within_s seconds without."""
        try:
            request = await asyncio.wait_for(self._requests.get(), within_s)
        except TimeoutError:
            return None
        if isinstance(request, UnknownCommand):
            self._refuse(str(request))
            return None
        if request.action is Action.HELP:
            self._answer("\n".join(f"{action:8}{meaning}" for action, meaning in MEANINGS.items()))
            return None
        return request

    def _answer(self, sentence: str) -> None:
        self._face.tell(Answered(sentence, is_refused=False))

    def _refuse(self, sentence: str) -> None:
        self._face.tell(Answered(sentence, is_refused=True))

    def _tell_once(self, event: Event) -> None:
        """What was told since the last trial already is not told again."""
        if event not in self._told:
            self._told.append(event)
            self._face.tell(event)

    def _ask_anew(self) -> None:
        """What was said of the trial before does not begin the next one."""
        self._is_started = False
        self._told = [event for event in self._told if not isinstance(event, Waiting)]

    # -- between two trials --------------------------------------------------------------------------------------

    async def _may_arm(self, plan: Agenda) -> bool:
        """Whether the next trial is to be armed now; False where the plan has to be looked at anew."""
        spec, order = plan.spec, order_of(plan, self._desk.session.config.protocol.pause_s)
        if spec is not None:
            trial = spec.cuff, spec.test, spec.repeat, spec.donning
            self._tell_once(NextTrial(*trial, plan.trials.index(spec) + 1, len(plan.trials), order))
        while not self._requests.empty():  # what was asked for while the trial before was judged
            command = await self._command(POLL_S)
            if command is not None and command.action is not Action.ARM and self._handle_between(command):
                return False
        while self._is_paused or (self._waits_for_start and not self._is_started):
            self._tell_once(
                Waiting("pause", "paused: arm goes on", BETWEEN)
                if self._is_paused
                else Waiting("start", f"{order}; then arm", BETWEEN)
            )
            command = await self._command(ELSEWHERE_S)
            if command is not None and command.action is Action.ARM:
                self._is_paused, self._is_started = False, True
                return plan.undecided is None
            if (command is not None and self._handle_between(command)) or self._plan != plan:
                return False
        return True

    def _is_left_to_others(self, recorded: Recorded) -> bool:
        """While this session is paused somebody else may record into its folder, and decides on that."""
        return self._is_paused and recorded.file not in self._recorded

    def _handle_between(self, command: Command) -> bool:
        """A command while no trial is recorded. Returns whether the plan is to be looked at anew."""
        desk = self._desk
        try:
            match command.action:
                case Action.REDO | Action.REDON:
                    self._told.clear()
                    self._face.tell(self._second_thoughts.redo_last(command))
                case Action.SKIP:
                    spec = desk.session.skip()
                    self._told.clear()
                    self._face.tell(Skipped(spec.cuff, spec.test, spec.repeat))
                case Action.UNDO:
                    self._told.clear()
                    self._second_thoughts.undo()
                case Action.PAUSE | Action.STOP:
                    self._is_paused = True
                case Action.FINISH:
                    self._is_paused = False
                    desk.session.is_ending = True
                case Action.END:
                    self._is_ended = True
                case _:
                    self._refuse(f"nothing to {command.action} now")
                    return False
        except (CommandRefused, JournalError) as refused:
            self._refuse(str(refused))
            return False
        self._ask_anew()
        return True

    async def _wait(self, seconds: float) -> None:
        """Until the next attempt; arm makes it at once."""
        until = time.monotonic() + seconds
        while (left := until - time.monotonic()) > 0:
            command = await self._command(left)
            if command is not None and (command.action is Action.ARM or self._handle_between(command)):
                return

    # -- the trial -----------------------------------------------------------------------------------------------

    async def _record(self) -> None:
        desk, last = self._desk, None
        try:
            await desk.runner.arm()
        except (CommandRefused, SimulationError, OSError) as error:
            self._face.tell(Warned("not_armed", str(error), self._retry_s))
            await self._wait_longer()
            return
        live, watch = desk.runner.live, TrialWatch(self._face.tell)
        while live is not None and desk.runner.live is live:
            command = await self._command(POLL_S)
            if command is not None:
                last = await self._handle_during(command, live) or last
            watch.look(live)
            self._face.show(live)
        self._face.show(None)
        if desk.runner.ended is not None:
            await self._account_for(desk.runner.ended, last)

    async def _handle_during(self, command: Command, live: Live) -> Command | None:
        """A command while a trial runs. Returns it where the trial ends with it and it concerns what comes then."""
        desk, is_recorded = self._desk, live.takes_marks
        try:
            match command.action:
                case Action.REDO | Action.REDON if is_recorded:
                    if not command.reason:
                        raise CommandRefused(WHY.format(command.action))
                    self._redo = command
                    await desk.runner.stop()
                case Action.SKIP | Action.UNDO if is_recorded:
                    raise CommandRefused("this trial is being recorded: stop it, or redo it and say why")
                case Action.PAUSE if is_recorded:
                    self._is_paused = True
                    self._answer("pauses after this trial")
                case Action.MARK:
                    await desk.runner.mark()
                    self._answer(f"mark {len(live.marks)}")
                case Action.SILENCE:
                    desk.runner.silence()
                case Action.FINISH if is_recorded:
                    await desk.runner.end_early()
                case Action.STOP | Action.END if is_recorded:
                    self._is_ended = self._is_ended or command.action is Action.END
                    await desk.runner.stop()
                case Action.KEEP | Action.ARM:
                    raise CommandRefused(f"nothing to {command.action} while a trial runs")
                case _:  # nothing is recorded yet: the trial is cancelled, and then it is done
                    await desk.runner.stop()
                    return command
        except CommandRefused as refused:
            self._refuse(str(refused))
        return None

    async def _account_for(self, trial: TrialProcess, command: Command | None) -> None:
        """What became of the trial, and what its operator wanted when it was cancelled."""
        recorded = trial.recorded
        if recorded is not None and recorded.file:
            self._told.clear()
            self._ask_anew()
            self._retry_s = FIRST_RETRY_S
            self._recorded.add(recorded.file)
            done = recorded.file, recorded.accepted, recorded.lost_samples, recorded.sentence
            self._face.tell(TrialEnded(*done))
        if command is not None:
            if recorded is None or not recorded.file or command.action in (Action.PAUSE, Action.END, Action.FINISH):
                self._handle_between(command)
            else:
                self._refuse(f"{command.action} came when the trial had just begun; decide on it now")
        elif trial.refusal is not None:
            self._tell_once(Warned("not_ready", trial.refusal, LAST_RETRY_S))
            await self._wait_longer()
        elif recorded is not None and not recorded.file:
            self._ask_anew()
            self._tell_once(Warned("not_recorded", recorded.sentence, FIRST_RETRY_S))
            await self._wait(FIRST_RETRY_S)

    async def _wait_longer(self) -> None:
        retry_s, self._retry_s = self._retry_s, min(2 * self._retry_s, LAST_RETRY_S)
        await self._wait(retry_s)

    # -- the verdict ---------------------------------------------------------------------------------------------

    async def _decide(self, recorded: Recorded) -> None:
        judged, redo = self._desk.session.judgement, self._redo
        if judged is None or judged.file != recorded.file:
            return
        self._face.tell(
            VerdictGiven(
                judged.file,
                judged.title,
                judged.advice,
                judged.reasons,
                judged.figures,
                judged.rows,
                judged.notes,
            )
        )
        self._redo = None
        if redo is not None:
            self._choose(recorded, "redo", redo.reason, "operator", is_donned_anew=redo.action is Action.REDON)
        elif judged.advice == "accept" and recorded.file not in self._second_thoughts.undone:
            self._choose(recorded, "accept", "", "station")
        else:
            reasons = f"better redo it: {'; '.join(judged.reasons)}" if judged.reasons else "keep it, or redo it"
            loses = redo_loses_migration(recorded, self._desk.session.journal)
            cost = ". Only redon keeps the migration measurable: the cuff may have slipped in it" if loses else ""
            self._face.tell(Waiting("decision", reasons + cost, DECISIONS))
            while not self._is_ended and not await self._is_decided(recorded, judged):
                pass

    async def _is_decided(self, recorded: Recorded, judged: Judgement) -> bool:
        """Waits a little for a decision, made here or elsewhere."""
        command = await self._command(ELSEWHERE_S)
        waits = self._plan.undecided
        if waits is None or waits.file != recorded.file:
            elsewhere = self._desk.session.journal.verdicts.get(recorded.file)
            if elsewhere is not None:
                self._face.tell(Decided(recorded.file, elsewhere.choice, elsewhere.reason, "elsewhere"))
            return True
        return command is not None and self._apply(command, recorded, "; ".join(judged.reasons))

    def _apply(self, command: Command, recorded: Recorded, why: str) -> bool:
        """A command on the recording that waits. Returns whether it decided; why is the reason unless one is given."""
        is_decided, reason = False, command.reason or why
        match command.action:
            case Action.KEEP:
                is_decided = self._choose(recorded, "accept", "", "operator")
            case Action.REDO | Action.REDON:
                is_donned_anew = command.action is Action.REDON
                is_decided = self._choose(recorded, "redo", reason, "operator", is_donned_anew=is_donned_anew)
            case Action.SKIP:
                is_decided = self._choose(recorded, "redo", f"skipped: {reason}", "operator")
                is_decided = is_decided and self._handle_between(command)
            case Action.PAUSE:
                self._is_paused = True
                self._answer("pauses after this decision")
            case Action.END:
                self._is_ended = True
            case _:
                self._refuse(f"{recorded.file} waits for a decision: {', '.join(DECISIONS)}")
        return is_decided

    def _choose(
        self, recorded: Recorded, choice: Choice, reason: str, by: str, *, is_donned_anew: bool = False
    ) -> bool:
        try:
            if is_donned_anew and recorded.cuff is None:
                raise CommandRefused(NO_CUFF)
            self._desk.reviewer.decide(choice, reason, is_donned_anew=is_donned_anew)
        except (CommandRefused, JournalError) as refused:
            self._refuse(str(refused))
            return False
        self._face.tell(Decided(recorded.file, choice, reason, by, is_donned_anew))  # type: ignore[arg-type]
        return True

    # -- the end -------------------------------------------------------------------------------------------------

    async def _sum_up(self) -> bool:
        """Fit, assessment and report. Returns whether that was done; redo and end are heard meanwhile."""
        desk = self._desk
        self._face.tell(SummingUp("fitting, assessing and writing the report"))
        work = asyncio.create_task(desk.reviewer.finish())
        while not work.done():
            command = await self._command(POLL_S)
            if command is not None and self._handle_between(command):
                work.cancel()
                desk.session.is_ending = desk.session.is_ending and command.action is Action.FINISH
                return False
        if desk.session.summary is None:
            self._face.tell(Warned("not_summed_up", desk.session.message))
            return True
        report = str(desk.session.folder / "report.html") if desk.session.folder else ""
        self._face.tell(SummedUp(desk.session.summary.rows, desk.session.summary.findings, report))
        return True

    def _close(self) -> None:
        plan = self._plan
        left = len(plan.trials) - len(plan.done) - len(plan.skipped)
        resume = f"`station record --config … --session {self._desk.session.folder}`"
        sentence = (
            f"{left} trials are left; go on with {resume}" if left else f"its report is not written; {resume} does"
        )
        if self.is_complete:
            sentence = "the session is summed up"
        counts = len(plan.trials), len(plan.done), len(plan.skipped)
        self._face.tell(SessionClosed(*counts, is_complete=self.is_complete, sentence=sentence))
