"""World services of simulation_interfaces: available scenarios, the running one, and loading another one."""

from __future__ import annotations

from typing import Any
from urllib.parse import unquote, urlsplit

from cable_twin.basics.printable import printable
from cable_twin.ros.executor import done
from cable_twin.ros.world_loading import WorldLoading
from cable_twin.runtime.scenario_reading import NoScenarioError, ScenarioReader
from cable_twin.scenario import Scenario, ScenarioError, config_directory

# of Result, and of LoadWorld
UNSUPPORTED, OK, NOT_FOUND, INCORRECT_STATE, FAILED = range(5)
UNSUPPORTED_FORMAT, NO_RESOURCE, RESOURCE_PARSE_ERROR = 101, 102, 103


def told(response: Any, result: int = OK, message: str = "") -> Any:
    """Fill the result of a response; returns the response."""
    response.result.result, response.result.error_message = result, message
    return response


class WorldServices:
    """Handlers of the world services of one twin.

    Args:
        scenario: that runs.
        loading: of another one.
        reader: of those that are named or sent.
        messages: module of the message types.

    Attributes:
        handlers: by the name of the service.
    """

    def __init__(self, scenario: Scenario, loading: WorldLoading, reader: ScenarioReader, messages: Any) -> None:
        self._scenario, self._loading, self._reader, self._messages = scenario, loading, reader, messages
        self.handlers = {
            "GetAvailableWorlds": self.get_available_worlds,
            "GetCurrentWorld": self.get_current_world,
            "LoadWorld": self.load_world,
        }

    async def get_available_worlds(self, request: Any, response: Any) -> Any:
        """Report the installed scenarios."""
        if request.additional_sources or request.filter.tags:
            return told(response, UNSUPPORTED, "additional_sources and tags are not known; allowed: none")
        reading = self._reader.worlds()
        await done(reading)
        response.worlds = []
        for name, description in reading.result():
            world = self._messages.WorldResource()
            world.name, world.description = name, description
            world.world_resource.uri = (config_directory() / f"{name}.yaml").as_uri()
            response.worlds.append(world)
        return told(response)

    async def load_world(self, request: Any, response: Any) -> Any:
        """Build another scenario; the twin then closes its logs and restarts paused at its start."""
        resource = request.world_resource
        if not resource.uri and not resource.resource_string:
            return told(response, NO_RESOURCE, "nothing given; allowed: uri, or YAML as resource_string")
        if self._loading.busy:
            return told(response, INCORRECT_STATE, "another world is being loaded")
        try:
            address = urlsplit(resource.uri)
        except ValueError:  # of brackets
            address = urlsplit("none:")
        if address.scheme not in ("", "file") or address.netloc not in ("", "localhost"):
            shown = printable(resource.uri)
            given = f"uri '{shown}' given; allowed: file:///PATH of a YAML file, or the name of a scenario"
            return told(response, UNSUPPORTED_FORMAT, given)
        source = unquote(address.path) if address.scheme else resource.uri
        reading = self._reader.read(source, "" if source else resource.resource_string)
        await done(reading)
        try:
            scenario = reading.result()
        except NoScenarioError as error:
            return told(response, NOT_FOUND, str(error))
        except ScenarioError as error:
            return told(response, RESOURCE_PARSE_ERROR, str(error))
        if self._loading.busy:
            return told(response, INCORRECT_STATE, "another world is being loaded")
        if fault := await self._loading.load(scenario, source or scenario.name, paused=True):
            return told(response, FAILED, fault)
        response.world.name, response.world.description = scenario.name, scenario.description
        response.world.world_resource = resource
        return told(response)

    def get_current_world(self, _: Any, response: Any) -> Any:
        """Report the running scenario, as YAML."""
        response.world.name, response.world.description = self._scenario.name, self._scenario.description
        response.world.world_resource.resource_string = self._scenario.to_yaml()
        return told(response)


__all__ = ["FAILED", "INCORRECT_STATE", "NOT_FOUND", "OK", "UNSUPPORTED", "WorldServices", "told"]
