// The peer of `bench frame`: another program that draws the same volume from the same views.

#ifndef ISOSCOPE_BENCH_PEER_H_
#define ISOSCOPE_BENCH_PEER_H_

#include <cstdint>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "core/cli/command.h"
#include "core/cli/interrupt.h"
#include "core/source/volume_source.h"

namespace isoscope::bench {

// Times in milliseconds.
struct PeerFigures {
  double cold_ms = 0;       // "cold_total" of the JSON it prints
  double following_ms = 0;  // "next_total"
  std::int64_t triangle_count = 0;
};

// The arguments of the peer's script.
struct PeerCall {
  std::string script;
  std::string raw_path;
  math::Index3 dims;
  std::string type;  // "uint8", ...
  math::Vec3d spacing{1, 1, 1};
  std::int64_t frame_count = 0;
  double orbit_degrees = 0;
  std::int64_t side_px = 0;
  std::vector<std::string> more = {};  // passed on unchanged
};

// Writes all samples of `source` to `path`: x fastest, little-endian, no header. In slabs, with
// progress. CANCELLED; errors of the source and of the disk.
absl::Status WriteRawSamples(source::VolumeSource& source, const std::string& path,
                             const cli::Context& context);

// Returns "xvfb-run ... /usr/bin/python3 SCRIPT RAW --dims ... --isovalue V", for a virtual
// display.
std::vector<std::string> PeerArguments(const PeerCall& call, double isovalue);

// Parses the single JSON object that the script prints; INTERNAL names a missing member.
absl::StatusOr<PeerFigures> PeerFiguresFromJson(absl::string_view text);

// Runs the peer once. NOT_FOUND: no xvfb-run. FAILED_PRECONDITION: it failed; with its last line.
absl::StatusOr<PeerFigures> RunPeer(const PeerCall& call, double isovalue,
                                    cli::Interrupt* interrupt);

}  // namespace isoscope::bench

#endif  // ISOSCOPE_BENCH_PEER_H_
