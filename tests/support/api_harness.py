"""The app without a network."""

import asyncio
from typing import Any

import httpx

from gcs.api.app import create_app
from tests.support.api_fake_service import FakeService


class Api:
    """An app over a fake service; each request runs on its own event loop."""

    def __init__(self, service: FakeService | None = None) -> None:
        self.service = service or FakeService()
        self.app = create_app(self.service)

    def __call__(self, method: str, path: str, **options: Any) -> httpx.Response:
        return asyncio.run(self._request(method, path, options))

    async def _request(self, method: str, path: str, options: dict[str, Any]) -> httpx.Response:
        transport = httpx.ASGITransport(self.app, raise_app_exceptions=False)
        async with httpx.AsyncClient(transport=transport, base_url="http://127.0.0.1") as client:
            return await client.request(method, path, **options)
