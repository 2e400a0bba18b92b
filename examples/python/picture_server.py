#!/usr/bin/env python3
"""A web back end with one endpoint: GET /DATASET.png?isovalue=60&azimuth=30&width=800 -> the exact picture.

    PYTHONPATH=clients/python/src python3 examples/python/picture_server.py [--server HOST:PORT] [--port N] ...
"""

import argparse

import isoscope
from aiohttp import web

STATUS = {"INVALID_ARGUMENT": 400, "NOT_FOUND": 404, "RESOURCE_EXHAUSTED": 429, "UNAVAILABLE": 503}


async def picture(request: web.Request) -> web.Response:
    query = request.query
    try:
        dataset = await request.app["client"].dataset(request.match_info["dataset"])
        frame = await dataset.render(
            float(query["isovalue"]) if "isovalue" in query else (await dataset.suggestions())[0].isovalue,
            view=query.get("view"),
            azimuth=float(query.get("azimuth", 0)),
            elevation=float(query.get("elevation", 0)),
            size=(int(query.get("width", 800)), int(query.get("height", 600))),
        )
    except isoscope.IsoscopeError as error:
        return web.Response(status=STATUS.get(error.code, 500), text=f"{error}\n")
    except (ValueError, IndexError) as error:
        return web.Response(status=400, text=f"{error}\n")
    # The same samples and request give the same bytes: the id says which.
    return web.Response(body=frame.png, content_type="image/png", headers={"X-Dataset-Id": dataset.id})


async def connected(app: web.Application):
    async with isoscope.aio.connect(app["server"], token_file=app["token_file"]) as app["client"]:
        yield


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--server", default="localhost:50051")
    parser.add_argument("--token-file", help="the token to send to the server")
    parser.add_argument("--port", type=int, default=8000)
    arguments = parser.parse_args()
    app = web.Application()
    app["server"], app["token_file"] = arguments.server, arguments.token_file
    app.cleanup_ctx.append(connected)
    app.router.add_get("/{dataset}.png", picture)
    web.run_app(app, host="127.0.0.1", port=arguments.port)
