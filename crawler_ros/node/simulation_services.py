"""The services of simulation_interfaces, as simulators of ROS 2 share them, where that package is installed."""

from __future__ import annotations

from importlib.util import find_spec
from typing import Any

_PACKAGE = "simulation_interfaces"


def open_simulation_services(simulator: Any) -> None:
    """Serve what a simulator of one crawler can do, if the package is there.

    Args:
        simulator: the node; the names of the services are relative to its namespace.
    """
    if find_spec(_PACKAGE) is not None:
        SimulationServices(simulator)


class SimulationServices:
    """Answers the services by what the node does for its own."""

    def __init__(self, simulator: Any) -> None:
        """Open the services.

        Args:
            simulator: the node.
        """
        from simulation_interfaces import srv
        from simulation_interfaces.msg import Result, SimulationState, SimulatorFeatures

        self._simulator, self._stopped = simulator, False
        self._result, self._state, self._features = Result, SimulationState, SimulatorFeatures
        for kind, name, answer in (
            (srv.GetSimulatorFeatures, "get_simulator_features", self._list_features),
            (srv.GetSimulationState, "get_simulation_state", self._tell_state),
            (srv.SetSimulationState, "set_simulation_state", self._set_state),
            (srv.ResetSimulation, "reset_simulation", self._reset),
            (srv.StepSimulation, "step_simulation", self._step),
        ):
            simulator.create_service(kind, name, answer)

    def _list_features(self, _: Any, response: Any) -> Any:
        kinds = self._features
        response.features.features = [
            kinds.SIMULATION_RESET,
            kinds.SIMULATION_STATE_GETTING,
            kinds.SIMULATION_STATE_SETTING,
            kinds.SIMULATION_STATE_PAUSE,
            kinds.STEP_SIMULATION_SINGLE,
            kinds.STEP_SIMULATION_MULTIPLE,
        ]
        response.features.custom_info = "one crawler a process; the parameter scene chooses it"
        return response

    @property
    def _present(self) -> int:
        if not self._simulator.tick_clock.paused:
            return int(self._state.STATE_PLAYING)
        return int(self._state.STATE_STOPPED if self._stopped else self._state.STATE_PAUSED)

    def _tell_state(self, _: Any, response: Any) -> Any:
        response.state.state = self._present
        return self._answer(response)

    def _set_state(self, request: Any, response: Any) -> Any:
        kinds, simulator, wanted = self._state, self._simulator, request.state.state
        if wanted == self._present:
            return self._answer(response, response.ALREADY_IN_TARGET_STATE, "it is in this state already")
        if wanted == kinds.STATE_QUITTING:
            simulator.stopping.set()
        elif wanted in (kinds.STATE_PLAYING, kinds.STATE_PAUSED, kinds.STATE_STOPPED):
            simulator.pause(wanted != kinds.STATE_PLAYING)
            self._stopped = wanted == kinds.STATE_STOPPED
            if self._stopped:
                simulator.reset()
        else:
            return self._answer(response, self._result.RESULT_NOT_FOUND, f"state {wanted} is unknown")
        return self._answer(response)

    def _reset(self, request: Any, response: Any) -> Any:
        both = request.SCOPE_TIME | request.SCOPE_STATE
        if request.scope not in (request.SCOPE_DEFAULT, request.SCOPE_ALL) and request.scope & both != both:
            text = "time and state are reset together: give SCOPE_ALL"
            return self._answer(response, self._result.RESULT_FEATURE_UNSUPPORTED, text)
        self._simulator.reset()
        return self._answer(response)

    def _step(self, request: Any, response: Any) -> Any:
        if not self._simulator.tick_clock.paused:
            text = "it is not paused: set STATE_PAUSED first"
            return self._answer(response, self._result.RESULT_INCORRECT_STATE, text)
        self._stopped = False
        for _ in range(request.steps):
            if self._simulator.stopping.is_set():
                return self._answer(response, self._result.RESULT_OPERATION_FAILED, "the simulator ends")
            self._simulator.step()
        return self._answer(response)

    def _answer(self, response: Any, result: int | None = None, text: str = "") -> Any:
        response.result.result = self._result.RESULT_OK if result is None else result
        response.result.error_message = text
        return response
