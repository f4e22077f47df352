"""Run a session without a page: arm trial after trial, judge each, and execute commands meanwhile.

Unlike the console it makes one decision itself: a recording without a reason to redo it is kept. The journal is read
before every step, so that a decision made elsewhere, for example by `station judge`, is used. An earlier decision can
be changed while no other recording waits.
"""

from __future__ import annotations

import asyncio
import time

from documents.message import Message, join_sentences
from station.bench.simulation import SimulationError
from station.journal import Choice, JournalError, Recorded
from station.messages.bench_messages import RefusalCode
from station.messages.session_messages import CommandCode, TerminalCode
from station.protocol import TrialSpec
from station.session.controller import SessionController
from station.session.judgement import Judgement
from station.session.open_session import CommandRefused
from station.session.plan_status import PlanStatus, kept_recordings, preparation, redo_loses_migration
from station.session.trial_runner import LiveTrial, TrialProcess
from station.terminal.commands import Action, Command, CommandQueue, Request, SessionOutput
from station.terminal.events import (
    Decided,
    NextTrial,
    PlanListed,
    SessionClosed,
    SessionEvent,
    SessionOpened,
    SummaryFinished,
    SummaryProgressed,
    SummaryStarted,
    TrialEnded,
    TrialMonitor,
    TrialSkipped,
    VerdictGiven,
    Waiting,
    WarningCode,
    WarningRaised,
)

POLL_S = 0.1
JOURNAL_POLL_S = 1.0
"""Wall seconds between two reads of the journal while a decision is awaited."""
FIRST_RETRY_S, LAST_RETRY_S = 2.0, 15.0
"""Wall seconds before arming is tried again; doubled after every failure."""
REMINDER_ATTEMPTS, UNATTENDED_ATTEMPTS = 4, 40
"""Attempts to arm after which the reason is shown again (about a minute), and after which a session without further
input ends (about 10 min)."""
NEEDS_OTHER_FOLDER = (RefusalCode.SIMULATED_DEVICES, RefusalCode.MIXED_ORIGIN, RefusalCode.PATH_TOO_LONG)
"""Refusals of a trial that every further attempt would meet, too."""
BETWEEN = ("arm", "redo", "redon", "undo", "skip", "next", "trials", "finish", "end")
DECISIONS = ("keep", "redo", "redon", "skip", "pause", "end")


class SessionSequencer:
    """One session, from its present state to its end. requests are the operator's commands."""

    def __init__(
        self,
        controller: SessionController,
        output: SessionOutput,
        requests: asyncio.Queue[Request],
        *,
        is_simulated: bool,
        waits_for_start: bool,
    ) -> None:
        """waits_for_start: the station starts the captures, so that a trial is armed only on the operator's command."""
        self._controller, self._output = controller, output
        self._commands = CommandQueue(requests, output, lambda: PlanListed.of(self._plan))
        self._is_simulated, self._waits_for_start = is_simulated, waits_for_start
        self._is_paused = self._is_ended = self.is_complete = self.is_refused = False
        self._is_started = False  # the operator started the next trial
        self._redo: Command | None = None  # of the running trial
        self._attempts = 0  # to arm, since the last trial that began
        self._recorded: set[str] = set()  # files of trials that were recorded here
        self._last_decision = LastDecision(controller)
        self._shown: list[SessionEvent] = []  # events that are not repeated

    async def run(self) -> None:
        """Return when the plan is complete and reported, or the operator ends. Raises JournalError."""
        plan, setup = self._plan, self._controller.session.journal.setup
        assert setup is not None  # noqa: S101  (the controller has opened a session)
        counts = len(plan.trials), len(plan.done), len(plan.skipped)
        folder = str(self._controller.session.folder)
        opened = SessionOpened(setup.subject, setup.number, folder, *counts, is_simulated=self._is_simulated)
        self._output.show_event(opened)
        while not self._is_ended:
            await self._controller.reviewer.process_recordings()
            plan = self._plan
            if plan.undecided is not None and not self._is_recorded_elsewhere(plan.undecided):
                await self._decide(plan.undecided)
            elif plan.undecided is None and (plan.spec is None or self._controller.session.is_ending):
                self.is_complete = await self._summarise()
                self._is_ended = self._is_ended or self.is_complete
            elif await self._may_arm(plan):
                await self._record()
        self._close()

    @property
    def has_summary(self) -> bool:
        return self._controller.session.summary is not None

    @property
    def _plan(self) -> PlanStatus:
        plan = self._controller.session.plan
        assert plan is not None  # noqa: S101  (the controller has opened a session)
        return plan

    def _show_once(self, event: SessionEvent) -> None:
        """Show an event unless it was shown since the last trial."""
        if event not in self._shown:
            self._shown.append(event)
            self._output.show_event(event)

    def _reset_start(self) -> None:
        """A start command counts for one trial only."""
        self._is_started = False
        self._shown = [event for event in self._shown if not isinstance(event, Waiting)]

    # -- between two trials --------------------------------------------------------------------------------------

    async def _may_arm(self, plan: PlanStatus) -> bool:
        """Whether to arm the next trial now; False if the plan may have changed."""
        spec, instruction = plan.spec, preparation(plan, self._controller.session.config)
        if spec is not None:
            trial = spec.cuff, spec.test, spec.repeat, spec.donning
            place = plan.trials.index(spec) + 1, len(plan.trials)
            left = self._controller.session.minutes_left
            self._show_once(NextTrial(*trial, *place, instruction, spec.condition, left))
        while not self._commands.is_empty:  # commands that arrived while the last trial was judged
            command = await self._commands.next(POLL_S)
            if command is not None and command.action is not Action.ARM and self._handle_between(command):
                return False
        while self._is_paused or (self._waits_for_start and not self._is_started):
            code = TerminalCode.PAUSED if self._is_paused else TerminalCode.START
            self._show_once(Waiting("pause" if self._is_paused else "start", str(Message(code)), BETWEEN))
            command = await self._commands.next(JOURNAL_POLL_S)
            if command is not None and command.action is Action.ARM:
                self._is_paused, self._is_started = False, True
                return plan.undecided is None
            if (command is not None and self._handle_between(command)) or self._plan != plan:
                return False
        return True

    def _is_recorded_elsewhere(self, recorded: Recorded) -> bool:
        """While this session is paused another process may record into its folder, and its operator decides."""
        return self._is_paused and recorded.file not in self._recorded

    def _handle_between(self, command: Command) -> bool:
        """Execute a command while no trial is recorded. Returns whether the plan may have changed."""
        controller = self._controller
        try:
            match command.action:
                case Action.REDO | Action.REDON:
                    self._shown.clear()
                    self._output.show_event(self._last_decision.redo(command))
                case Action.SKIP:
                    skipped = controller.session.skip(self._named_trial(command))
                    self._shown.clear()
                    self._output.show_event(TrialSkipped(skipped.cuff, skipped.test, skipped.repeat, skipped.condition))
                case Action.NEXT if (chosen := self._named_trial(command)) is not None:
                    controller.session.choose(chosen)
                    self._shown.clear()
                case Action.UNDO:
                    self._shown.clear()
                    self._last_decision.undo()
                case Action.PAUSE | Action.STOP:
                    self._is_paused = True
                case Action.FINISH:
                    self._is_paused = False
                    controller.session.is_ending = True
                case Action.END:
                    self._is_ended = True
                case _:
                    self._commands.refuse_with(CommandCode.NOT_NOW, action=command.action.value)
                    return False
        except (CommandRefused, JournalError) as refused:
            self._commands.refuse(refused)
            return False
        self._reset_start()
        return True

    def _named_trial(self, command: Command) -> TrialSpec | None:
        """The trial that a command names by its number. Raises CommandRefused."""
        return None if command.trial is None else self._controller.session.trial(command.trial)

    async def _wait(self, seconds: float) -> None:
        """Wait for the next attempt; arm makes it at once."""
        until = time.perf_counter() + seconds
        while (left := until - time.perf_counter()) > 0:
            command = await self._commands.next(left)
            if command is not None and (command.action is Action.ARM or self._handle_between(command)):
                return

    # -- the trial -----------------------------------------------------------------------------------------------

    async def _record(self) -> None:
        runner, last = self._controller.runner, None
        try:
            await runner.arm()
        except (CommandRefused, SimulationError, OSError) as error:
            return await self._retry("not_armed", str(error))
        live, monitor = runner.live, TrialMonitor(self._output.show_event)
        while live is not None and runner.live is live:
            command = await self._commands.next(POLL_S)
            if command is not None:
                last = await self._handle_during(command, live) or last
            monitor.update(live)
            self._output.show_trial(live)
        self._output.show_trial(None)
        return None if runner.ended is None else await self._finish_trial(runner.ended, last)

    async def _handle_during(self, command: Command, live: LiveTrial) -> Command | None:
        """Execute a command while a trial runs. Returns a command that cancels it and is to be executed afterwards."""
        runner, is_recorded = self._controller.runner, live.takes_marks
        try:
            match command.action:
                case _ if is_recorded and command.trial is not None:
                    raise CommandRefused.of(CommandCode.BEING_RECORDED)
                case Action.REDO | Action.REDON if is_recorded:
                    if not command.reason:
                        raise CommandRefused.of(CommandCode.REASON_MISSING, action=command.action.value)
                    self._redo = command
                    await runner.stop()
                case Action.SKIP | Action.UNDO if is_recorded:
                    raise CommandRefused.of(CommandCode.BEING_RECORDED)
                case Action.PAUSE if is_recorded:
                    self._is_paused = True
                    self._commands.answer(str(Message(TerminalCode.PAUSE_AFTER_TRIAL)))
                case Action.MARK:
                    await runner.mark()
                    self._commands.answer(str(Message(TerminalCode.MARKED, {"number": len(live.marks)})))
                case Action.SILENCE:
                    runner.acknowledge_alarm()
                case Action.FINISH if is_recorded:
                    await runner.end_early()
                case Action.STOP | Action.END if is_recorded:
                    self._is_ended = self._is_ended or command.action is Action.END
                    await runner.stop()
                case Action.KEEP | Action.ARM:
                    raise CommandRefused.of(CommandCode.NOT_WHILE_RUNNING, action=command.action.value)
                case _:  # nothing is recorded yet: cancel the trial, then execute the command
                    await runner.stop()
                    return command
        except CommandRefused as refused:
            self._commands.refuse(refused)
        return None

    async def _finish_trial(self, trial: TrialProcess, command: Command | None) -> None:
        """Show the outcome of the trial, and execute the command that cancelled it."""
        recorded = trial.recorded
        if recorded is not None and recorded.file:
            self._shown.clear()
            self._reset_start()
            self._attempts = 0
            self._recorded.add(recorded.file)
            codes = tuple(code for message in recorded.codes for code in message.codes)
            outcome = recorded.file, recorded.accepted, recorded.lost_samples, recorded.sentence, codes
            self._output.show_event(TrialEnded(*outcome))
        if command is not None:
            if recorded is None or not recorded.file or command.action in (Action.PAUSE, Action.END, Action.FINISH):
                self._handle_between(command)
            else:
                self._commands.refuse_with(CommandCode.TOO_LATE, action=command.action.value)
        elif trial.refusal_code == RefusalCode.UNREADABLE_MESSAGE:  # the trial was recorded: nothing is tried again
            self._show_once(WarningRaised("telemetry_unread", str(trial.refusal), cause=trial.refusal_code))
        elif trial.refusal is not None:
            await self._retry("not_ready", trial.refusal, trial.refusal_code)
        elif recorded is not None and not recorded.file:
            self._reset_start()
            cause = recorded.codes[0].code.value if recorded.codes else ""
            self._show_once(WarningRaised("not_recorded", recorded.sentence, FIRST_RETRY_S, cause))
            await self._wait(FIRST_RETRY_S)

    async def _retry(self, code: WarningCode, sentence: str, cause: str = "") -> None:
        """Show why no trial can begin, now and then again, and wait for the next attempt, or end a session that no
        further attempt helps and one without an operator.
        """
        self._attempts += 1
        is_unattended = self._commands.has_ended and self._attempts >= UNATTENDED_ATTEMPTS
        self.is_refused = is_unattended or cause in NEEDS_OTHER_FOLDER
        warning = WarningRaised(code, sentence, None if self.is_refused else LAST_RETRY_S, cause)
        if self._attempts % REMINDER_ATTEMPTS == 0:
            self._shown = [event for event in self._shown if event != warning]
        self._show_once(warning)
        if self.is_refused:
            self._is_ended = True
        else:
            await self._wait(min(FIRST_RETRY_S * 2 ** min(self._attempts - 1, REMINDER_ATTEMPTS), LAST_RETRY_S))

    # -- the verdict ---------------------------------------------------------------------------------------------

    async def _decide(self, recorded: Recorded) -> None:
        judgement, redo = self._controller.session.judgement, self._redo
        if judgement is None or judgement.file != recorded.file:
            return
        self._output.show_event(VerdictGiven.of(judgement))
        self._redo = None
        if redo is not None:
            self._choose(recorded, "redo", redo.reason, "operator", is_donned_anew=redo.action is Action.REDON)
        elif judgement.advice == "accept" and recorded.file not in self._last_decision.undone:
            self._choose(recorded, "accept", "", "station")
        else:
            loses_migration = redo_loses_migration(recorded, self._controller.session.journal)
            self._output.show_event(
                Waiting("decision", _question(judgement, loses_migration=loses_migration), DECISIONS)
            )
            while not self._is_ended and not await self._is_decided(recorded, judgement):
                pass

    async def _is_decided(self, recorded: Recorded, judgement: Judgement) -> bool:
        """Wait JOURNAL_POLL_S for a decision, made here or elsewhere."""
        command = await self._commands.next(JOURNAL_POLL_S)
        undecided = self._plan.undecided
        if undecided is None or undecided.file != recorded.file:
            verdict = self._controller.session.journal.verdicts.get(recorded.file)
            if verdict is not None:
                self._output.show_event(Decided(recorded.file, verdict.choice, verdict.reason, "elsewhere"))
            return True
        return command is not None and self._apply(command, recorded, join_sentences(judgement.reasons))

    def _apply(self, command: Command, recorded: Recorded, default_reason: str) -> bool:
        """Apply a command to the recording that waits. Returns whether it is decided."""
        is_decided, reason = False, command.reason or default_reason
        match command.action:
            case _ if command.trial is not None:
                self._refuse_before_decision(recorded)
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
                self._commands.answer(str(Message(TerminalCode.PAUSE_AFTER_DECISION)))
            case Action.END:
                self._is_ended = True
            case _:
                self._refuse_before_decision(recorded)
        return is_decided

    def _refuse_before_decision(self, recorded: Recorded) -> None:
        self._commands.refuse_with(CommandCode.WAITS_FOR_DECISION, file=recorded.file, commands=", ".join(DECISIONS))

    def _choose(
        self, recorded: Recorded, choice: Choice, reason: str, by: str, *, is_donned_anew: bool = False
    ) -> bool:
        try:
            if is_donned_anew and recorded.cuff is None:
                raise CommandRefused.of(CommandCode.BOUNCE_NOT_DONNED)
            self._controller.reviewer.decide(choice, reason, is_donned_anew=is_donned_anew)
        except (CommandRefused, JournalError) as refused:
            self._commands.refuse(refused)
            return False
        self._output.show_event(Decided(recorded.file, choice, reason, by, is_donned_anew))  # type: ignore[arg-type]
        return True

    # -- the end -------------------------------------------------------------------------------------------------

    async def _summarise(self) -> bool:
        """Fit, assess and report. Returns whether that ended; redo and end interrupt it."""
        session = self._controller.session
        self._output.show_event(SummaryStarted(str(Message(TerminalCode.SUMMARY_STARTED))))
        work = asyncio.create_task(self._controller.reviewer.finish())
        shown = 0
        while not work.done():
            command = await self._commands.next(POLL_S)
            for stage in self._controller.reviewer.stages[shown:]:
                shown += 1
                self._output.show_event(SummaryProgressed(stage.name, stage.total))
            if command is not None and self._handle_between(command):
                work.cancel()
                session.is_ending = session.is_ending and command.action is Action.FINISH
                return False
        if session.summary is None:
            self._output.show_event(WarningRaised("not_summed_up", session.message))
            return True
        report = str(session.folder / "report.html") if session.folder else ""
        self._output.show_event(SummaryFinished(session.summary.rows, session.summary.findings, report))
        return True

    def _close(self) -> None:
        plan = self._plan
        left = len(plan.trials) - len(plan.done) - len(plan.skipped)
        practice = " --simulated" if self._is_simulated else ""
        command = f"`station record --config … --session {self._controller.session.folder}{practice}`"
        code = TerminalCode.TRIALS_LEFT if left else TerminalCode.REPORT_MISSING
        message = Message(TerminalCode.COMPLETE if self.is_complete else code, {"left": left, "command": command})
        counts = len(plan.trials), len(plan.done), len(plan.skipped)
        self._output.show_event(SessionClosed(*counts, is_complete=self.is_complete, sentence=str(message)))


def _question(judgement: Judgement, *, loses_migration: bool) -> str:
    """The request for a decision."""
    if not judgement.reasons:
        return str(Message(TerminalCode.DECIDE_OR_REDON if loses_migration else TerminalCode.DECIDE))
    code = TerminalCode.REDON_ADVISED if loses_migration else TerminalCode.REDO_ADVISED
    return str(Message(code, {"reasons": join_sentences(judgement.reasons)}))


class LastDecision:
    """undone are the files of undone decisions; the operator decides on them, not the station."""

    def __init__(self, controller: SessionController) -> None:
        self._controller = controller
        self.undone: set[str] = set()
        self._warned: set[str] = set()  # files for which the loss of migration was reported

    def undo(self) -> None:
        """The recording of the last decision waits for a decision again. Raises CommandRefused."""
        file = self._last_file()
        self._controller.reviewer.undo(file)
        self.undone.add(file)

    def redo(self, command: Command) -> Decided:
        """Set the recording of the last decision, or of the trial that the command names, aside; its trial is left
        again. Raises CommandRefused.

        The first redo that would lose the migration is refused.
        """
        journal, recorded = self._controller.session.journal, self._named_recording(command)
        is_donned_anew = command.action is Action.REDON
        if recorded.file in journal.redone:
            raise CommandRefused.of(CommandCode.NOTHING_TO_REDO)
        if not command.reason:
            raise CommandRefused.of(CommandCode.REASON_MISSING, action=command.action.value)
        if is_donned_anew and recorded.cuff is None:
            raise CommandRefused.of(CommandCode.BOUNCE_NOT_DONNED)
        if not is_donned_anew and recorded.file not in self._warned and redo_loses_migration(recorded, journal):
            self._warned.add(recorded.file)
            raise CommandRefused.of(CommandCode.LOSES_MIGRATION, file=recorded.file)
        self._controller.reviewer.undo(recorded.file)
        self._controller.reviewer.decide("redo", command.reason, is_donned_anew=is_donned_anew)
        return Decided(recorded.file, "redo", command.reason, "operator", is_donned_anew)

    def _named_recording(self, command: Command) -> Recorded:
        """Raises CommandRefused if there is none."""
        journal = self._controller.session.journal
        if command.trial is not None:
            spec = self._controller.session.trial(command.trial)
            if not (kept := kept_recordings(spec, journal)):
                raise CommandRefused.of(CommandCode.NOT_DONE, trial=spec.title)
            return kept[-1]
        recorded = next((trial for trial in journal.recorded if trial.file == self._last_file()), None)
        if recorded is None:
            raise CommandRefused.of(CommandCode.NOTHING_TO_REDO)
        return recorded

    def _last_file(self) -> str:
        """Verdicts are in the order of the decisions."""
        return next(reversed(list(self._controller.session.journal.verdicts)), "")
