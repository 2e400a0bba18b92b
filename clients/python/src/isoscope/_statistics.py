"""The cost of a frame."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass(frozen=True)
class SurfaceStatistics:
    """Cost of one surface of a frame: triangles, and grid edges that it crosses, in the drawn blocks."""

    triangle_count: int
    unique_vertex_count: int


@dataclass(frozen=True)
class AgentStatistics:
    """Cost of one agent's part in a frame. Milliseconds are wall time.

    Attributes:
        address: as the coordinator dialled it.
        shards: shards that it worked on.
        active_block_count, visible_block_count: blocks that a surface meets; that were drawn.
        triangle_count: extracted for this frame.
        read_bytes: read from disk.
        busy_ms: all its work; extract_ms and render_ms are parts of it.
    """

    address: str
    shards: tuple[int, ...]
    active_block_count: int
    visible_block_count: int
    triangle_count: int
    read_bytes: int
    busy_ms: float
    extract_ms: float
    render_ms: float


@dataclass(frozen=True)
class Statistics:
    """Cost of one frame, over all agents, with the names of `isoscope render --stats FILE.json`.

    Attributes:
        active_block_count: blocks that a surface meets and that are not clipped.
        ray_hit_block_count: blocks that rays of the depth estimate hit.
        visible_block_count: blocks that were extracted and drawn.
        culled_block_count: active blocks outside the view, or hidden.
        occluding_block_count: blocks that were drawn first.
        triangle_count: extracted for this frame, of all surfaces.
        unique_vertex_count: grid edges that cross an isovalue, in the drawn blocks.
        read_bytes: read from shards; bytes found in a cache don't count.
        network_bytes: of messages between coordinator and agents.
        png_bytes: size of the PNG; 0 if none was asked for.
        truncated_pixel_count: pixels with more translucent fragments than max_layers.
        missing_shards: whose blocks the picture lacks; only with `allow_partial`.
        active_block_coverage: share of the active blocks that the picture has a chance to show; None if no shard is
            missing.
        band_count: bands that the picture was drawn in, because the whole does not fit a memory limit; 1: at once.
        unresolved_block_count: active blocks of level 0 that the drawn level shows nothing of; no bound of what it
            hides. None at level 0, and if it is not known (`count_unresolved`).
        durations_ms: wall time by step, milliseconds: "occluder_selection", "occluder_rendering",
            "visibility_culling", "composite", "encode".
        agents: parts of the agents.
        surfaces: by surface, in the order of the request.
        level: whose blocks, triangles and vertices these are.
    """

    active_block_count: int
    ray_hit_block_count: int
    visible_block_count: int
    culled_block_count: int
    occluding_block_count: int
    triangle_count: int
    unique_vertex_count: int
    read_bytes: int
    network_bytes: int
    png_bytes: int
    truncated_pixel_count: int
    missing_shards: tuple[int, ...] = ()
    active_block_coverage: float | None = None
    band_count: int = 1
    unresolved_block_count: int | None = None
    durations_ms: dict[str, float] = field(default_factory=dict)
    agents: tuple[AgentStatistics, ...] = ()
    surfaces: tuple[SurfaceStatistics, ...] = ()
    level: int = 0

    @property
    def seconds(self) -> float:
        """Time of the frame in the coordinator, seconds."""
        return sum(self.durations_ms.values()) / 1000
