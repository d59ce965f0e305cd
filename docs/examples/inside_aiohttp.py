"""A gateway inside an aiohttp program: values over HTTP, beside clients that speak Modbus.

    python docs/examples/inside_aiohttp.py docs/examples/plant.toml
    curl http://127.0.0.1:8080/units/grid/active-power
    curl -X PUT -d 180 http://127.0.0.1:8080/units/oven/setpoint
    curl -N http://127.0.0.1:8080/events

Whoever reaches this server may do what the program may: all, unless the config has an [[access]] row for `embedded`.
"""

import json
import sys
from collections.abc import Awaitable, Callable
from contextlib import AsyncExitStack

from aiohttp import web

from gateway import Busy, Gateway, LineDown, NoResponse, NotConfigured, Refused

CONFIG = web.AppKey("CONFIG", str)
GATEWAY = web.AppKey("GATEWAY", Gateway)
STACK = web.AppKey("STACK", AsyncExitStack)
Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]


async def start(app: web.Application) -> None:
    """Start the gateway before the server listens."""
    app[GATEWAY] = await app[STACK].enter_async_context(Gateway.from_toml(app[CONFIG]))


async def stop(app: web.Application) -> None:
    """Stop the gateway before the server waits for its clients: that ends their streams of events."""
    await app[STACK].aclose()


async def get_point(request: web.Request) -> web.Response:
    """Ask the device now."""
    unit = request.app[GATEWAY].unit(request.match_info["unit"])
    reading = await unit.read(request.match_info["point"])
    return web.json_response({"value": reading.value, "unit": reading.unit, "time": reading.time.isoformat()})


async def put_point(request: web.Request) -> web.Response:
    """Write a value, which is the body as JSON."""
    unit = request.app[GATEWAY].unit(request.match_info["unit"])
    await unit.write(request.match_info["point"], await request.json())
    return web.Response(status=204)


async def stream_events(request: web.Request) -> web.StreamResponse:
    """Send what happens, as server-sent events, until the client leaves or the gateway stops."""
    response = web.StreamResponse(headers={"Content-Type": "text/event-stream"})
    await response.prepare(request)
    async for event in request.app[GATEWAY].events():
        data = json.dumps({"level": event.level.name, "text": event.in_words()})
        await response.write(f"event: {event.name}\ndata: {data}\n\n".encode())
    return response


@web.middleware
async def tell_errors(request: web.Request, handler: Handler) -> web.StreamResponse:
    """Give each error of the gateway its HTTP status."""
    try:
        return await handler(request)
    except NotConfigured as error:
        raise web.HTTPNotFound(text=str(error)) from None
    except ValueError as error:  # the body is no JSON, or the value does not fit
        raise web.HTTPBadRequest(text=str(error)) from None
    except Refused as error:
        raise web.HTTPUnprocessableEntity(text=str(error)) from None
    except (Busy, LineDown) as error:  # nothing was sent: it may be tried again
        raise web.HTTPServiceUnavailable(text=str(error)) from None
    except NoResponse as error:  # a write may have been carried out
        raise web.HTTPGatewayTimeout(text=str(error)) from None


def application(config: str) -> web.Application:
    """Make the web application."""
    app = web.Application(middlewares=[tell_errors])
    app[CONFIG], app[STACK] = config, AsyncExitStack()
    app.on_startup.append(start)
    app.on_shutdown.append(stop)
    app.router.add_get("/units/{unit}/{point}", get_point)
    app.router.add_put("/units/{unit}/{point}", put_point)
    app.router.add_get("/events", stream_events)
    return app


if __name__ == "__main__":
    web.run_app(application(sys.argv[1]), host="127.0.0.1", port=8080)
