#include "server/frame/pixel_queue.h"

#include <algorithm>
#include <new>
#include <utility>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "absl/time/clock.h"

namespace isoscope::server {
namespace {

// A full tile of a band has about as many bytes.
constexpr std::size_t kFullTileBytes = 1024;
// Tiles that one thread composites in some hundred microseconds. To wake another one takes as long.
constexpr std::size_t kTilesPerHelper = 512;

std::size_t TileCountOf(const image::DrawnPixels& pixels) {
  std::size_t count = pixels.image.touched.Count();
  for (const image::FrameImage* level : pixels.layers.Levels()) {
    count += level->touched.Count();
  }
  return count;
}

}  // namespace

void PixelQueue::Push(AttemptId from, Bands bands) {
  is_first_ = false;
  std::vector<Arrival> arrivals;
  arrivals.reserve(bands.bands.size());
  for (std::string& band : bands.bands) {
    const std::size_t tile_count = band.size() / kFullTileBytes + 1;
    arrivals.push_back({from, std::move(band), bands.hold, tile_count});
  }
  Push(std::move(arrivals));
}

// The first image becomes the result; others are composited into it.
void PixelQueue::Push(AttemptId from, image::DrawnPixels pixels) {
  if (std::exchange(is_first_, false)) {
    reduction_.Adopt(&pixels);
    if (!reduction_.has_layers()) {
      return;
    }
  }
  std::vector<Arrival> arrivals;
  const std::size_t tile_count = TileCountOf(pixels);
  arrivals.push_back({from, std::move(pixels), nullptr, tile_count});
  Push(std::move(arrivals));
}

// Calls threads of the arena to help if the pixels are more than the frame's own thread composites
// in the time that it takes to wake another one.
void PixelQueue::Push(std::vector<Arrival> arrivals) {
  has_tasks_ = true;
  std::size_t more_helpers = 0;
  {
    const base::MutexLock lock(&mutex_);
    for (Arrival& arrival : arrivals) {
      waiting_tiles_ += arrival.tile_count;
      arrivals_.push_back(std::move(arrival));
    }
    const std::size_t wanted = std::min({waiting_tiles_ / kTilesPerHelper, arrivals_.size(),
                                         static_cast<std::size_t>(arena_.max_concurrency())});
    more_helpers = wanted - std::min(wanted, helper_count_);
    helper_count_ += more_helpers;
  }
  if (more_helpers > 0) {
    arena_.execute([&] {
      for (std::size_t i = 0; i < more_helpers; ++i) {
        helpers_.run([this] { Help(); });
      }
    });
  }
}

// Composites until nothing waits.
void PixelQueue::Help() {
  while (CompositeNext()) {
  }
  const base::MutexLock lock(&mutex_);
  --helper_count_;
}

bool PixelQueue::empty() const {
  const base::MutexLock lock(&mutex_);
  return arrivals_.empty();
}

// Takes what arrived first, unless another thread has.
std::optional<PixelQueue::Arrival> PixelQueue::Pop() {
  const base::MutexLock lock(&mutex_);
  if (arrivals_.empty()) {
    return std::nullopt;
  }
  std::optional<Arrival> arrival(std::move(arrivals_.front()));
  arrivals_.pop_front();
  waiting_tiles_ -= arrival->tile_count;
  return arrival;
}

// Composites what arrived first; false if nothing waits. The pixels and their memory are free when
// it returns.
bool PixelQueue::CompositeNext() {
  const std::optional<Arrival> arrival = Pop();
  if (!arrival.has_value()) {
    return false;
  }
  const auto* const band = std::get_if<std::string>(&arrival->pixels);
  const absl::Status status =
      band != nullptr ? reduction_.CompositeBand(*band)
                      : reduction_.CompositeDrawn(std::get<image::DrawnPixels>(arrival->pixels),
                                                  arrival->tile_count >= kTilesPerHelper);
  if (!status.ok()) {
    {
      const base::MutexLock lock(&mutex_);
      damages_.push_back({arrival->from, AgentWord::kDamaged, absl::Now(),
                          absl::Status(status.code(), absl::StrCat("pixels: ", status.message()))});
    }
    on_damage_();
  }
  return true;
}

std::vector<AgentEvent> PixelQueue::Finish() {
  arena_.execute([&] {
    while (CompositeNext()) {
    }
    helpers_.wait();
  });
  has_tasks_ = false;
  std::vector<AgentEvent> damages;
  const base::MutexLock lock(&mutex_);
  damages.swap(damages_);
  return damages;
}

// In the arena: one of one thread has nobody else to run the tasks.
void PixelQueue::Abandon() noexcept {
  if (!std::exchange(has_tasks_, false)) {
    return;
  }
  while (Pop().has_value()) {
  }
  try {
    arena_.execute([&] { helpers_.wait(); });
  } catch (const std::bad_alloc&) {
    // A task has thrown it. All are done, and the frame has failed anyhow.
  }
}

}  // namespace isoscope::server
