#include "bench/peer.h"

#include <algorithm>
#include <cstddef>
#include <memory>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include <nlohmann/json.hpp>

#include "bench/child_process.h"
#include "core/base/status_macros.h"
#include "core/base/units.h"
#include "core/cli/progress_line.h"
#include "core/io/file.h"

namespace isoscope::bench {
namespace {

constexpr std::int64_t kSlabBytes = 16 * base::kMiB;

std::string Triple(double x, double y, double z) {
  return absl::StrFormat("%.17g,%.17g,%.17g", x, y, z);
}

}  // namespace

absl::Status WriteRawSamples(source::VolumeSource& source, const std::string& path,
                             const cli::Context& context) {
  const math::Index3& dims = source.info().geometry.sample_dims;
  const auto layer_bytes =
      dims.x * dims.y * static_cast<std::int64_t>(volume::SizeOf(source.info().type));
  const std::int64_t layers = std::max<std::int64_t>(1, kSlabBytes / layer_bytes);
  ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<io::WritableFile> file,
                            io::CreateWritableFile(path));
  std::string slab;
  cli::ProgressLine line(context.err, context.err_is_terminal);
  for (std::int64_t z = 0; z < dims.z; z += layers) {
    ISOSCOPE_RETURN_IF_ERROR(context.interrupt->cancellation().Check());
    const std::int64_t end_z = std::min(z + layers, dims.z);
    slab.resize(static_cast<std::size_t>((end_z - z) * layer_bytes));
    ISOSCOPE_RETURN_IF_ERROR(source.ReadSlab(z, end_z, slab.data()));
    ISOSCOPE_RETURN_IF_ERROR(file->Append(slab));
    line.Update("raw samples", end_z * layer_bytes, dims.z * layer_bytes);
  }
  return file->Close();
}

std::vector<std::string> PeerArguments(const PeerCall& call, double isovalue) {
  std::vector<std::string> arguments = {
      "xvfb-run",
      "-a",
      "-s",
      "-screen 0 1280x1024x24",
      "/usr/bin/python3",
      call.script,
      call.raw_path,
      "--dims",
      absl::StrCat(call.dims.x, ",", call.dims.y, ",", call.dims.z),
      "--type",
      call.type,
      "--isovalue",
      absl::StrFormat("%.17g", isovalue),
      "--frames",
      absl::StrCat(call.frame_count),
      "--orbit",
      absl::StrFormat("%.17g", call.orbit_degrees),
      "--size",
      absl::StrCat(call.side_px)};
  if (call.spacing != math::Vec3d{1, 1, 1}) {
    arguments.insert(arguments.end(),
                     {"--spacing", Triple(call.spacing.x, call.spacing.y, call.spacing.z)});
  }
  arguments.insert(arguments.end(), call.more.begin(), call.more.end());
  return arguments;
}

absl::StatusOr<PeerFigures> PeerFiguresFromJson(absl::string_view text) {
  const auto json = nlohmann::json::parse(text.begin(), text.end(), /*cb=*/nullptr,
                                          /*allow_exceptions=*/false);
  if (!json.is_object()) {
    return absl::InternalError(
        absl::StrCat("the peer printed no JSON object but '", text.substr(0, 80), "'"));
  }
  for (const char* key : {"cold_total", "next_total"}) {
    if (!json.contains(key) || !json[key].is_number()) {
      return absl::InternalError(
          absl::StrCat("the peer's JSON has no number \"", key, "\" (milliseconds)"));
    }
  }
  PeerFigures figures{.cold_ms = json["cold_total"].get<double>(),
                      .following_ms = json["next_total"].get<double>()};
  if (json.contains("triangles") && json["triangles"].is_number_integer()) {
    figures.triangle_count = json["triangles"].get<std::int64_t>();
  }
  return figures;
}

absl::StatusOr<PeerFigures> RunPeer(const PeerCall& call, double isovalue,
                                    cli::Interrupt* interrupt) {
  absl::StatusOr<ChildResult> child = RunChild(PeerArguments(call, isovalue), "", interrupt);
  if (absl::IsNotFound(child.status())) {
    return absl::NotFoundError(
        "--peer needs xvfb-run, which is not in PATH; install the package xvfb");
  }
  ISOSCOPE_RETURN_IF_ERROR(child.status());
  if (child->exit_code != 0) {
    return absl::FailedPreconditionError(
        absl::StrCat("the peer ", call.script, " ended with exit code ", child->exit_code, ": ",
                     LastLine(child->err + "\n" + child->out)));
  }
  return PeerFiguresFromJson(child->out);
}

}  // namespace isoscope::bench
