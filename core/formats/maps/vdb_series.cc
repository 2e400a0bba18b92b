// The child loads the module with libopenvdb. So no other process runs the threads that one of its
// libraries (log4cplus) starts, and none waits for it to load. A volume's number has two parts:
//
//   2 * grid + is_joined       grid: as the module lists them; is_joined: as in vdb_child.h
//
// Source: OpenVDB 10, https://www.openvdb.org/documentation/doxygen.

#include "core/formats/maps/vdb_series.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <system_error>
#include <utility>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"

#include "core/base/status_macros.h"
#include "core/base/units.h"
#include "core/formats/maps/vdb_child.h"
#include "core/source/adapt/wide_source.h"
#include "core/source/child/decoder_module.h"
#include "core/source/child/walled_series.h"
#include "core/source/child/walled_source.h"
#include "core/source/grid/affine_grid.h"

namespace isoscope::source {
namespace {

constexpr std::int64_t kMaxVdbBoxBytes = std::int64_t{1} << 40;

// ---- The child. ---------------------------------------------------------------------------------

absl::StatusOr<const VdbModule*> LoadVdbModule() {
  ISOSCOPE_ASSIGN_OR_RETURN(void* const symbol, LoadDecoderModule({.file = "isoscope_vdb.so",
                                                                   .symbol = "IsoscopeVdbCalls",
                                                                   .format = "OpenVDB"}));
  return static_cast<const VdbModule*>(reinterpret_cast<const void* (*)()>(symbol)());
}

bool IsVdbNamed(const std::string& part, const std::string& name) {
  return (part == name && !part.empty()) || absl::StartsWith(part, absl::StrCat(name, ":"));
}

absl::Status VdbTypeError(const std::string& path, const std::vector<VdbGrid>& grids) {
  constexpr std::size_t kMaxListed = 20;
  std::vector<std::string> texts;
  for (const VdbGrid& grid : grids) {
    if (texts.size() == kMaxListed) {
      texts.emplace_back("and more");
      break;
    }
    texts.push_back(absl::StrFormat("\"%s\" (%s)", grid.name, grid.type));
  }
  return absl::InvalidArgumentError(absl::StrFormat(
      "%s: %s; expected grids of float, double, int32, int64, bool, mask, or vectors of three: "
      "convert it, as vdb_tool does",
      path, texts.empty() ? "no grid in it" : absl::StrCat("grid ", absl::StrJoin(texts, ", "))));
}

// The transform, by the first grid that has it, of most of the grids that can be read; not set if
// there is none.
std::optional<std::int64_t> CommonTransform(const std::vector<VdbGrid>& grids) {
  std::optional<std::int64_t> common;
  std::map<std::int64_t, int> counts;
  for (const VdbGrid& grid : grids) {
    if (grid.components > 0 && grid.is_linear) {
      ++counts[grid.alike];
    }
  }
  for (const auto& [alike, count] : counts) {
    if (!common.has_value() || count > counts[*common]) {
      common = alike;
    }
  }
  return common;
}

SourceField VdbFieldOf(const VdbGrid& grid, const std::vector<VdbGrid>& grids,
                       const std::string& path) {
  SourceField field{.name = grid.name,
                    .long_name = grid.grid_class == "unknown" ? "" : grid.grid_class};
  if (grid.name == "[0]") {
    std::string name = path.substr(path.rfind('/') + 1);
    name.resize(name.size() - (absl::EndsWithIgnoreCase(name, ".vdb") ? 4 : 0));
    const bool is_taken = std::any_of(grids.begin(), grids.end(),
                                      [&](const VdbGrid& other) { return other.name == name; });
    field.name = is_taken || name.empty() ? grid.name : name;
  }
  if (grid.components == 3) {
    field.components = {"x", "y", "z"};
  }
  return field;
}

absl::StatusOr<std::vector<std::string>> DescribeVdb(const std::string& path,
                                                     const std::string& part) {
  ISOSCOPE_ASSIGN_OR_RETURN(const VdbModule* const module, LoadVdbModule());
  ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<VdbGrid> grids, module->list(path));
  const std::optional<std::int64_t> common = CommonTransform(grids);
  const bool is_joined = part.empty() && common.has_value();
  WalledFile described;
  for (std::size_t i = 0; i < grids.size(); ++i) {
    const VdbGrid& grid = grids[i];
    if (grid.components == 0 && IsVdbNamed(part, grid.name)) {
      return VdbTypeError(path, {grid});
    }
    if (grid.components > 0 && (!is_joined || (grid.is_linear && grid.alike == *common))) {
      described.Add(VdbFieldOf(grid, grids, path),
                    2 * static_cast<std::int64_t>(i) + (is_joined ? 1 : 0));
    }
  }
  if (described.numbers.empty()) {
    return VdbTypeError(path, grids);
  }
  return WalledTexts(described);
}

class VdbSource final : public VolumeSource {
 public:
  VdbSource(std::unique_ptr<VdbVolume> volume, const volume::GridGeometry& geometry,
            const std::string& path)
      : VolumeSource({.name = path,
                      .geometry = geometry,
                      .type = volume->header().type,
                      .memory_bytes = volume->header().memory_bytes}),
        volume_(std::move(volume)) {}

  absl::Status ReadRows(std::int64_t begin_row, std::int64_t end_row, char* out) override {
    return volume_->ReadRows(begin_row, end_row, out);
  }

 private:
  const std::unique_ptr<VdbVolume> volume_;
};

absl::StatusOr<std::unique_ptr<VolumeSource>> OpenVdbPart(const std::string& path,
                                                          const std::string& part) {
  const auto [number, step, component] = ParseWalledPart(part);
  ISOSCOPE_ASSIGN_OR_RETURN(const VdbModule* const module, LoadVdbModule());
  ISOSCOPE_ASSIGN_OR_RETURN(std::unique_ptr<VdbVolume> volume,
                            module->open(path, number / 2, component, number % 2 == 1));
  const VdbVolume::Header& header = volume->header();
  ISOSCOPE_ASSIGN_OR_RETURN(
      const volume::GridGeometry geometry,
      GridFromAffine(header.dims, header.world_from_index, PatientWorld::kLps, path));
  const bool is_int64 = header.is_int64;
  auto source = std::make_unique<VdbSource>(std::move(volume), geometry, path);
  if (is_int64) {
    return MakeWideSource(std::move(source), WideType::kInt64);
  }
  return source;
}

// ---- The parent. --------------------------------------------------------------------------------

// Returns the bytes of the library and its threads, the mapped file, and the nodes and masks of its
// tree.
std::int64_t VdbMemoryBytes(const std::string& path) {
  constexpr std::uintmax_t kMostBytes = std::uintmax_t{1} << 50;
  std::error_code error;
  const std::uintmax_t file_bytes = std::filesystem::file_size(path, error);
  return 2 * base::kGiB +
         4 * (error ? 0 : static_cast<std::int64_t>(std::min(file_bytes, kMostBytes)));
}

// Checks what a grid may have and a dataset has not.
class VdbSeries final : public VolumeSeries {
 public:
  VdbSeries(std::unique_ptr<VolumeSeries> grids, const GridRules& rules)
      : VolumeSeries(grids->info()), grids_(std::move(grids)), rules_(rules) {}

  absl::StatusOr<std::unique_ptr<VolumeSource>> Open(int field, int component, int step) override {
    ISOSCOPE_ASSIGN_OR_RETURN(std::unique_ptr<VolumeSource> volume,
                              grids_->Open(field, component, step));
    const std::string title = absl::StrCat(info().name, ":", info().field(field).name);
    const volume::GridGeometry& geometry = volume->info().geometry;
    const std::optional<Shear> shear = FindShear(geometry.direction);
    if (shear.has_value() && !rules_.ignores_shear) {
      return ShearError(*shear, title);
    }
    const math::Index3& dims = geometry.sample_dims;
    const auto sample_bytes = static_cast<std::int64_t>(volume::SizeOf(volume->info().type));
    if (dims.x > kMaxVdbBoxBytes / sample_bytes / dims.y / dims.z) {
      return absl::InvalidArgumentError(absl::StrFormat(
          "%s: the box of its active voxels has %d x %d x %d samples, %.4g TiB if it is filled; "
          "expected at most 1 TiB: clip or resample the grid in the program that wrote it (--crop "
          "and --stride can't help: they choose from the filled box)",
          title, dims.x, dims.y, dims.z,
          static_cast<double>(dims.x) * static_cast<double>(dims.y) * static_cast<double>(dims.z) *
              static_cast<double>(sample_bytes) / static_cast<double>(kMaxVdbBoxBytes)));
    }
    return volume;
  }

 private:
  const std::unique_ptr<VolumeSeries> grids_;
  const GridRules rules_;
};

}  // namespace

bool IsVdb(absl::string_view head) {
  return absl::StartsWith(head, absl::string_view(" BDV\0\0\0\0", 8));
}

absl::StatusOr<std::unique_ptr<VolumeSeries>> OpenVdbSeries(const std::string& file,
                                                            const std::string& part,
                                                            const GridRules& rules) {
  const WalledLibrary library = {.name = "OpenVDB",
                                 .open = OpenVdbPart,
                                 .find_files = nullptr,
                                 .describe = DescribeVdb,
                                 .memory_bytes = VdbMemoryBytes(file)};
  ISOSCOPE_ASSIGN_OR_RETURN(std::unique_ptr<VolumeSeries> grids,
                            OpenWalledSeries(library, file, part));
  return std::make_unique<VdbSeries>(std::move(grids), rules);
}

}  // namespace isoscope::source
