// The memory limit of a coordinator, and its shares (docs/operations.md, "Memory"). It decides
// which frames are drawn at once, which in bands, and which not at all.

#ifndef ISOSCOPE_SERVER_ADMISSION_COORDINATOR_MEMORY_H_
#define ISOSCOPE_SERVER_ADMISSION_COORDINATOR_MEMORY_H_

#include <cstddef>
#include <functional>
#include <optional>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

#include "core/base/cancellation.h"
#include "core/base/memory_budget.h"
#include "core/frame/frame_spec.h"
#include "server/admission/band_grid.h"
#include "server/admission/frame_bytes.h"  // IWYU pragma: export

namespace isoscope::server {

// A span of a trace: 24 bytes where it is recorded, 216 as a message, 40 in an answer, which gRPC
// copies.
inline constexpr std::size_t kTraceSpanBytes = 320;

// What a frame's call asks of the memory.
struct FrameWish {
  Delivery delivery = Delivery::kWhole;
  bool has_trace = false;
  bool may_band = false;  // whether the call can draw in bands
};

// What is known of a frame once its dataset is.
struct FrameNeeds {
  std::size_t counting_bytes = 0;  // to count what several bands draw once
  // The most drawn pixels of a band, with samples and margin, because of an agent's limit; 0: any.
  std::size_t max_drawn_pixels = 0;
};

// Thread-safe. Outlives its reservations.
class CoordinatorMemory {
 public:
  static constexpr std::size_t kMinLimitBytes = std::size_t{96} * 1024 * 1024;

  // A quarter of the memory that the process may use, at least 1 GiB.
  static std::size_t DefaultLimitBytes();

  // The least limit, in bytes, with which the agents of the same process draw a frame.
  using AgentLimit = std::function<std::size_t(const frame::FrameSpec& spec)>;

  // agent_limit: of agents whose limit is raised by the same flag; null: they have their own.
  // REQUIRES: limit_bytes >= kMinLimitBytes.
  explicit CoordinatorMemory(std::size_t limit_bytes, AgentLimit agent_limit = nullptr);

  // The limits of data that is kept between frames: images that no frame uses, and active blocks.
  [[nodiscard]] std::size_t unused_image_bytes() const;
  [[nodiscard]] std::size_t active_blocks_bytes() const;
  // The limit of pixels that views keep between the tiles of their pictures.
  [[nodiscard]] std::size_t tiles_bytes() const;

  [[nodiscard]] std::size_t limit_bytes() const { return limit_bytes_; }
  // The bytes that frames and exports have reserved.
  [[nodiscard]] std::size_t frame_bytes() const { return frames_.reserved_bytes(); }
  [[nodiscard]] std::size_t export_bytes() const { return exports_.reserved_bytes(); }

  // Bytes of a frame's trace: spans of the coordinator and of all agents, until it is sent.
  [[nodiscard]] std::size_t trace_bytes() const;
  [[nodiscard]] std::size_t max_trace_spans() const { return trace_bytes() / kTraceSpanBytes; }

  // RESOURCE_EXHAUSTED if the frame can never fit, in bands neither: says size, bytes and limit,
  // and the least limit that is enough.
  [[nodiscard]] absl::Status CheckFits(const frame::FrameSpec& spec, const FrameWish& wish) const;
  // Takes the memory of a frame; waits until it is free. Errors of CheckFits, and of `cancellation`
  // if it fires first. A frame in bands leaves a quarter of what its answer leaves to others. Beside
  // agents of this process, a frame that exceeds what they leave takes all of that, and runs alone.
  absl::StatusOr<base::MemoryBudget::Reservation> ReserveFrame(
      const frame::FrameSpec& spec, const FrameWish& wish, const base::Cancellation& cancellation);
  // Takes memory for the pixels of a picture between its tiles; none if there is not enough now. Does
  // not wait: who keeps it waits for frames, and would hold up others that wait for it.
  std::optional<base::MemoryBudget::Reservation> TryKeepTiles(std::size_t bytes);
  // Returns the bands in which a frame is drawn that has its memory: one if it is drawn at once.
  // With max_drawn_pixels it is drawn in bands even if it fits, within what ReserveFrame has taken
  // to draw it at once. CULLING_MASK is always drawn at once. Errors as CheckFits.
  [[nodiscard]] absl::StatusOr<BandGrid> PlanFrame(const frame::FrameSpec& spec,
                                                   const FrameWish& wish,
                                                   const FrameNeeds& needs) const;
  // Returns the bands of another drawing of the same picture, such as one with one sample, within
  // what ReserveFrame has taken for the frame. The drawing is not sent, and takes no more than the
  // frame does. Errors as PlanFrame of the frame.
  [[nodiscard]] absl::StatusOr<BandGrid> PlanDrawing(const frame::FrameSpec& drawing,
                                                     const frame::FrameSpec& frame,
                                                     const FrameWish& wish,
                                                     const FrameNeeds& needs) const;
  // Bytes of an export on their way to its client: queued chunks, and gRPC's copy.
  static constexpr std::size_t kExportAnswerBytes = std::size_t{16} * 1024 * 1024;
  // Takes the memory of an export: data on its way from each agent and to the client. Exports have
  // their own share, so that an export with a slow client blocks no frame. An export larger than
  // the share takes and exceeds all of it. Waits, as ReserveFrame. The agents' part may be given
  // back (ShrinkTo) when they are done, and the rest when the client has the mesh.
  absl::StatusOr<base::MemoryBudget::Reservation> ReserveExport(
      std::size_t agent_count, const base::Cancellation& cancellation);

 private:
  [[nodiscard]] bool FitsAtOnce(const frame::FrameSpec& spec, std::size_t limit_bytes,
                                const FrameWish& wish) const;
  // The bytes for the answer and the bands of frames.
  [[nodiscard]] std::size_t BandCapacity(std::size_t limit_bytes) const;
  // The bytes for the answer and the bands of a frame, without its trace and what counts blocks.
  [[nodiscard]] std::size_t BytesForBands(const frame::FrameSpec& spec, std::size_t limit_bytes,
                                          const FrameWish& wish, const FrameNeeds& needs) const;
  // bytes: BytesForBands of the frame and the limit
  [[nodiscard]] bool FitsInBands(const frame::FrameSpec& spec, const view::Viewport& band,
                                 std::size_t limit_bytes, std::size_t bytes, Delivery delivery,
                                 std::size_t max_drawn_pixels) const;
  [[nodiscard]] bool AgentsFit(const frame::FrameSpec& spec, std::size_t limit_bytes) const;
  [[nodiscard]] bool AgentsFitBand(const frame::FrameSpec& spec, const view::Viewport& band,
                                   std::size_t limit_bytes) const;
  [[nodiscard]] std::size_t LeastLimitFor(const frame::FrameSpec& spec, const FrameWish& wish,
                                          const FrameNeeds& needs) const;
  [[nodiscard]] absl::Status TooLarge(const frame::FrameSpec& spec, const FrameWish& wish,
                                      const FrameNeeds& needs) const;
  // Whether agents of this process have no room for the smallest band, though bands take less than
  // the whole.
  [[nodiscard]] bool SmallestBandExceedsAgents(const frame::FrameSpec& spec) const;
  [[nodiscard]] absl::Status TooLargeForAgents(const frame::FrameSpec& spec, const FrameWish& wish,
                                               const FrameNeeds& needs) const;

  const std::size_t limit_bytes_;
  const AgentLimit agent_limit_;
  base::MemoryBudget frames_;
  base::MemoryBudget exports_;
  base::MemoryBudget tiles_;
};

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_ADMISSION_COORDINATOR_MEMORY_H_
