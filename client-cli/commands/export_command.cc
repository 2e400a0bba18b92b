// isoscope export INPUT | DIR | --server HOST:PORT --isovalue V --output FILE
//
// CheckUsage checks the flags against each other and the format of the file. SurfaceExporter gets
// the surfaces and writes them; then their counts and measures are told.

#include <algorithm>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <ostream>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include <nlohmann/json.hpp>

#include "client-cli/commands/program.h"
#include "client-cli/commands/surface_exporter.h"
#include "client-cli/commands/surface_notes.h"
#include "client-cli/output/mesh_files.h"
#include "client-cli/output/surface_measures.h"
#include "client-cli/output/surface_name.h"
#include "client-cli/session/session.h"
#include "clients/cpp/connection/features.h"
#include "clients/cpp/connection/label_query.h"
#include "clients/cpp/connection/mesh_export.h"
#include "clients/cpp/connection/service_client.h"
#include "clients/cpp/mesh_file/mesh_measures.h"
#include "clients/cpp/mesh_file/mesh_piece.h"
#include "clients/cpp/mesh_file/mesh_writer.h"
#include "clients/cpp/request/clip_flags.h"
#include "clients/cpp/request/dataset_fields.h"
#include "clients/cpp/request/json_text.h"
#include "clients/cpp/request/level_flags.h"
#include "clients/cpp/request/parse_value.h"
#include "clients/cpp/request/render_request.h"
#include "clients/cpp/request/selection_flags.h"
#include "core/base/monotonic_time.h"
#include "core/base/printable.h"
#include "core/base/status_macros.h"
#include "core/cli/flags.h"
#include "core/cli/format.h"
#include "core/cli/usage.h"
#include "core/io/atomic_file.h"
#include "core/mesh/world_placement.h"
#include "core/volume/grid_geometry.h"
#include "isoscope/v1/dataset.pb.h"
#include "isoscope/v1/isosurface_service.pb.h"
#include "wire/proto_convert.h"

namespace isoscope::cli {
namespace {

struct ExportFlags {
  bool is_quiet = false;
  SessionFlags session;
  std::optional<double> isovalue;
  std::vector<client::SurfaceValue> surfaces;
  client::LabelFlags label;
  client::ClipFlags clip;
  client::SelectionFlags selection;
  std::optional<std::string> output;
  std::optional<client::MeshFormat> format;
  std::optional<frame::Color> color;
  MeshFilters filters;
  bool closes = false;
  std::optional<std::string> stats;
  std::optional<std::string> dataset_id;
  std::optional<std::int64_t> level;

  [[nodiscard]] bool is_coarse() const { return level.value_or(0) > 0; }
  // Those of isovalues, then those of labels. REQUIRES: CheckUsage is OK.
  [[nodiscard]] std::vector<client::MeshSurface> mesh_surfaces() const {
    std::vector<client::MeshSurface> list;
    if (isovalue) {
      list.push_back({.isovalue = *isovalue, .color = color});
    }
    for (const client::SurfaceValue& surface : surfaces) {
      list.push_back({.isovalue = surface.isovalue, .color = surface.color});
    }
    for (const client::LabelSurface& surface : label.surfaces) {
      list.push_back({.color = surface.color, .name = surface.name});
    }
    for (const client::LabelValue& value : label.sets) {  // the dataset tells which
      if (label.surfaces.empty()) {
        list.push_back({.color = value.color, .name = value.set});
      }
    }
    if (list.empty()) {
      list.push_back({.name = "label"});
    }
    return list;
  }
};

absl::StatusOr<double> ParseShare(absl::string_view text) {
  absl::StatusOr<double> share = client::ParseNumber(text);
  if (!share.ok() || *share <= 0 || *share >= 1) {
    return absl::InvalidArgumentError(
        absl::StrCat("'", text, "' is not a share of the triangles, above 0 and below 1"));
  }
  return share;
}

absl::Status CheckUsage(const ExportFlags& flags) {
  ISOSCOPE_RETURN_IF_ERROR(CheckUsage(flags.session));
  if (!flags.isovalue && flags.surfaces.empty() && flags.label.empty()) {
    ISOSCOPE_RETURN_IF_ERROR(CheckInputExists(flags.session));
  }
  ISOSCOPE_RETURN_IF_ERROR(client::CheckSurfaces(flags.isovalue, flags.surfaces, flags.color,
                                                 flags.label, client::kAnyNumberOfSurfaces));
  for (const client::LabelValue& value : flags.label.sets) {
    if (value.opacity.value_or(1) != 1.0F) {
      return UsageError(absl::StrCat("--label ", value.set, " has opacity ", *value.opacity,
                                     ": meshes are opaque, leave :OPACITY out"));
    }
  }
  for (const client::SurfaceValue& surface : flags.surfaces) {
    if (surface.color && surface.color->alpha != 1.0F) {
      return UsageError(absl::StrCat("--surface ", surface.isovalue, " has opacity ",
                                     surface.color->alpha,
                                     ": meshes are opaque, leave :OPACITY out"));
    }
  }
  if (!flags.output) {
    return UsageError("--output FILE is missing: the mesh to write");
  }
  if (*flags.output == "-") {
    return UsageError("--output -: a mesh is written to a file, not to standard output: name one");
  }
  if (flags.stats && flags.is_coarse()) {
    return UsageError("--stats has the measures of level 0: leave --level out, or --stats");
  }
  if (flags.stats && *flags.stats != "-") {
    ISOSCOPE_RETURN_IF_ERROR(io::CheckWritable(*flags.stats));
  }
  ISOSCOPE_RETURN_IF_ERROR(CheckSurfaceName(*flags.output));
  ISOSCOPE_RETURN_IF_ERROR(CheckUsage(flags.selection));
  return CheckUsage(flags.clip);
}

// A format without colours drops those that nobody asked for.
void DropDefaultColors(const client::LabelFlags& label, client::MeshFileOptions* options) {
  const std::size_t first = options->surfaces.size() - label.surfaces.size();
  for (std::size_t i = 0; i < label.surfaces.size(); ++i) {
    if (!label.surfaces[i].is_color_given) {
      options->surfaces[first + i].color.reset();
    }
  }
}

absl::StatusOr<client::MeshFileOptions> FileOptions(const ExportFlags& flags) {
  ISOSCOPE_RETURN_IF_ERROR(CheckUsage(flags));
  client::MeshFileOptions options{.path = *flags.output, .surfaces = flags.mesh_surfaces()};
  const absl::StatusOr<client::MeshFormat> format =
      client::MeshFormatOf(*flags.output, flags.format);
  ISOSCOPE_RETURN_IF_ERROR(AsUsageError(format.status()));
  options.format = *format;
  if (options.format == client::MeshFormat::kStl) {
    DropDefaultColors(flags.label, &options);
  }
  ISOSCOPE_RETURN_IF_ERROR(AsUsageError(client::Validate(options)));
  return options;
}

isoscope::v1::ExportIsosurfaceRequest MakeRequest(const ExportFlags& flags,
                                                  const std::string& dataset) {
  isoscope::v1::ExportIsosurfaceRequest request =
      client::MakeExportRequest(flags.isovalue, flags.surfaces, flags.clip, dataset, flags.label);
  if (const auto selection = client::ToProto(flags.selection)) {
    *request.mutable_selection() = *selection;
  }
  request.set_dataset_id(flags.dataset_id.value_or(""));
  request.set_level(static_cast<std::int32_t>(flags.level.value_or(0)));
  return request;
}

absl::Status CheckServer(const ExportFlags& flags, const isoscope::v1::Dataset& dataset,
                         bool knows_closed_meshes, const Context& context) {
  if (knows_closed_meshes) {
    return absl::OkStatus();
  }
  if (flags.closes || flags.stats) {
    return absl::FailedPreconditionError(absl::StrCat("the server does not know ",
                                                      flags.closes ? "--close" : "--stats",
                                                      ": it is older than this program"));
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const volume::GridGeometry geometry,
                            wire::GeometryFromProto(dataset.geometry(), "geometry"));
  if (mesh::WorldPlacement(geometry).has_origin()) {
    *context.err << "isoscope: the server is older than this program, and rounds positions to "
                    "float32: neighbouring vertices may fall together"
                 << std::endl;
  }
  return absl::OkStatus();
}

void Report(const MeshFiles& files, const std::vector<MeasuredSurface>& surfaces,
            const std::string& unit, absl::Duration duration, const Context& context) {
  for (const MeshFileReport& file : files.reports()) {
    *context.out << base::Printable(file.path) << ": " << FormatCount(file.vertex_count)
                 << " vertices, " << FormatCount(file.triangle_count) << " triangles, "
                 << FormatMebibytes(file.size_bytes) << ", in " << FormatElapsed(duration) << "\n";
  }
  constexpr std::size_t kMaxLines = 16;
  for (std::size_t i = 0; i < std::min(surfaces.size(), kMaxLines); ++i) {
    *context.out << DescribeMeasures(surfaces[i], unit) << "\n";
  }
  if (surfaces.size() > kMaxLines) {
    *context.out << "... and " << surfaces.size() - kMaxLines << " more; --stats - lists all\n";
  }
}

absl::Status WriteStats(const ExportFlags& flags, const MeshFiles& files,
                        const std::vector<MeasuredSurface>& surfaces, const std::string& unit,
                        const Context& context) {
  nlohmann::ordered_json json = MeasuresToJson(surfaces, unit);
  json["files"] = nlohmann::ordered_json::array();
  for (const MeshFileReport& file : files.reports()) {
    json["files"].push_back({{"path", file.path},
                             {"vertex_count", file.vertex_count},
                             {"triangle_count", file.triangle_count},
                             {"size_bytes", file.size_bytes}});
  }
  const std::string text = client::JsonText(json);
  if (*flags.stats == "-") {
    *context.out << text;
    return absl::OkStatus();
  }
  return io::WriteFileAtomically(*flags.stats, text);
}

// The files of the export. REQUIRES: labels are resolved.
absl::StatusOr<std::vector<client::MeshFileOptions>> FilesOf(const ExportFlags& flags,
                                                             const client::MeshFileOptions& all) {
  if (!HasSurfaceName(*flags.output)) {
    return std::vector<client::MeshFileOptions>{all};
  }
  std::vector<NamedSurface> named;
  for (const client::MeshSurface& surface : all.surfaces) {
    named.push_back({.isovalue = surface.isovalue});
  }
  for (std::size_t i = 0; i < flags.label.surfaces.size(); ++i) {
    const client::LabelSurface& label = flags.label.surfaces[i];
    named[named.size() - flags.label.surfaces.size() + i] = {.labels = label.values,
                                                             .name = label.name};
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<std::string> names,
                            SurfaceFileNames(*flags.output, named));
  std::vector<client::MeshFileOptions> files;
  for (std::size_t i = 0; i < names.size(); ++i) {
    ISOSCOPE_RETURN_IF_ERROR(io::CheckWritable(names[i]));
    client::MeshFileOptions& file = files.emplace_back(all);
    file.path = names[i];
    file.surfaces = {all.surfaces[i]};
  }
  return files;
}

std::string ParentFolder(const std::string& path) {
  const std::string folder = std::filesystem::path(path).parent_path().string();
  return folder.empty() ? "." : folder;
}

absl::Status Run(const ExportFlags& given, const Context& context) {
  ExportFlags flags = given;
  ISOSCOPE_ASSIGN_OR_RETURN(client::MeshFileOptions file_options, FileOptions(flags));
  if (!HasSurfaceName(*flags.output)) {
    ISOSCOPE_RETURN_IF_ERROR(io::CheckWritable(*flags.output));
  }
  const WantedVolumes wanted{.selection = flags.selection};
  ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<Session> session,
                            Session::Open(flags.session, &wanted, std::nullopt, context));
  ISOSCOPE_ASSIGN_OR_RETURN(const isoscope::v1::Dataset dataset, session->GetDataset());
  session->AdaptSelection(&flags.selection);
  ISOSCOPE_RETURN_IF_ERROR(client::ResolveNames(dataset, &flags.selection));
  ISOSCOPE_RETURN_IF_ERROR(client::ResolveLabels(dataset, flags.selection, session->frame_timeout(),
                                                 &session->client(), &flags.label,
                                                 client::kAnyNumberOfSurfaces));
  ISOSCOPE_ASSIGN_OR_RETURN(file_options, FileOptions(flags));
  ISOSCOPE_ASSIGN_OR_RETURN(
      const bool knows_closed_meshes,
      client::HasFeature("closed_meshes", session->question_timeout(), &session->client()));
  ISOSCOPE_RETURN_IF_ERROR(CheckServer(flags, dataset, knows_closed_meshes, context));
  isoscope::v1::ExportIsosurfaceRequest request = MakeRequest(flags, dataset.name());
  request.set_closes(flags.closes);
  request.set_with_origin(knows_closed_meshes);
  request.set_with_measures(knows_closed_meshes && !flags.is_coarse());
  file_options.field = client::PinSelection(dataset, &request);
  const base::MonotonicTime start = base::MonotonicNow();
  ISOSCOPE_ASSIGN_OR_RETURN(std::vector<client::MeshFileOptions> file_list,
                            FilesOf(flags, file_options));
  MeshFiles files(std::move(file_list));
  // Standard output may be that of the statistics.
  const Context report = flags.stats == "-" ? QuietContext(context) : context;
  SurfaceExporter exporter(flags.filters, request, session.get(), &files, report);
  ISOSCOPE_RETURN_IF_ERROR(exporter.Run(ParentFolder(*flags.output)));
  if (files.origin().has_value() && !client::HasDoubles(file_options.format)) {
    *context.err << "isoscope: positions in the file are from the origin "
                 << client::TextOfOrigin(*files.origin())
                 << ", because float32 can't tell neighbouring vertices of the world apart"
                 << std::endl;
  }
  std::vector<std::string> names;
  for (const client::LabelSurface& label : flags.label.surfaces) {
    names.push_back(label.name);
  }
  std::vector<MeasuredSurface> surfaces;
  if (!flags.is_coarse()) {  // measures are of level 0
    surfaces = MeasuredSurfaces(request, names, exporter.measures());
  }
  Report(files, surfaces, dataset.length_unit(), base::MonotonicNow() - start, report);
  if (flags.stats) {
    ISOSCOPE_RETURN_IF_ERROR(WriteStats(flags, files, surfaces, dataset.length_unit(), context));
  }
  return WriteNotesOnMesh(
      request, [&files](int surface) { return files.HasTriangles(surface); }, session.get(),
      context);
}

Action RegisterExportFlags(FlagSet* set) {
  const auto flags = std::make_shared<ExportFlags>();
  AddSessionFlags(set, &flags->session, {.format = "--input-format"});
  AddFlag(set, "--isovalue", "V", &flags->isovalue, client::ParseNumber,
          "the isovalue, in field units");
  AddRepeatableFlag(
      set, "--surface", "V[:COLOR]", &flags->surfaces, client::ParseSurface,
      "a surface: its isovalue and colour; instead of --isovalue and --color, any number "
      "of times. All go into one file: as primitives with materials in GLB, as objects "
      "in OBJ, with a surface index of vertices in PLY and VTP");
  client::AddLabelFlags(set, &flags->label, /*has_opacity=*/false);
  client::AddClipFlags(set, &flags->clip, "export");
  client::AddSelectionFlags(set, &flags->selection);
  AddFlag(
      set, "-o,--output", "FILE", &flags->output, ParseText,
      "the mesh; its suffix says the format: .ply (binary), .stl (binary), .obj, .glb, .vtp, "
      "all but STL with vertex normals. It goes to disk as it comes, in a few MiB of memory, "
      "whatever its size; a .stl, --min-component and --simplify use scratch files beside it, "
      "of which memory holds what the system leaves there, and --simplify some 200 MiB. With %l "
      "in the name each surface has its own file, as label-%l.stl: %l is the label or the "
      "isovalue, %03l has leading zeros, %n is the label's name");
  AddFlag(set, "--format", "ply|stl|obj|glb|vtp", &flags->format, client::ParseMeshFormat,
          "the format, for a name without a suffix (default: ply)");
  AddFlag(set, "--color", "COLOR", &flags->color, client::ParseColor,
          "colour of the surface, a name of CSS as teal, #RRGGBB, or R,G,B from 0 to 1: of its "
          "vertices in PLY, OBJ and VTP, of its "
          "material in GLB (default: none)");
  AddFlag(
      set, "--min-component", "N", &flags->filters.min_component,
      [](absl::string_view text) { return client::ParseInteger(text, 1, INT64_MAX); },
      "leave out islands of fewer than N triangles, as they are once clipped");
  AddFlag(set, "--simplify", "SHARE", &flags->filters.simplify_share, ParseShare,
          "keep this share of the triangles of each surface, above 0 and below 1, without cracks");
  AddFlag(set, "--simplify-error", "E", &flags->filters.simplify_error, client::ParsePositiveNumber,
          "remove triangles while the surface moves by no more than E world units, as "
          "libmeshoptimizer estimates it; with --simplify, whichever is first");
  set->AddSwitch(
      "--close", &flags->closes,
      "close each surface where its solid ends: at the border of the volume, at the clip "
      "planes and the box, and at samples that are NaN; for 3D printing");
  AddFlag(set, "--stats", "FILE|-", &flags->stats, ParseText,
          "write area, enclosed volume and triangles of each surface as JSON, after the filters; "
          "'-' is standard output, in place of all else there");
  AddFlag(set, "--dataset-id", "ID", &flags->dataset_id, ParseText,
          "fail if the dataset under that name has another id; `isoscope info` prints it");
  client::AddMeshLevelFlag(set, &flags->level);
  AddQuietFlag(set, &flags->is_quiet);
  return [flags](const Context& context) {
    return Run(*flags, flags->is_quiet ? QuietContext(context) : context);
  };
}

}  // namespace

Command ExportCommand() {
  return {.name = "export",
          .summary = "Writes whole isosurfaces as one welded mesh: PLY, STL, OBJ, GLB or VTP",
          .usage = "INPUT | DIR | --server HOST:PORT --isovalue V --output FILE [OPTIONS]",
          .examples =
              "  isoscope export head.nii.gz --isovalue 60 --output head.ply\n"
              "  isoscope export head.nii.gz --isovalue 60 --min-component 1000 \\\n"
              "    --simplify 0.1 --color 0.9,0.85,0.8 --output head.glb\n"
              "  isoscope export head.nii.gz --surface 30:0.9,0.7,0.6 --surface 75:1,1,0.9 \\\n"
              "    --clip-plane 1,0,0,40 --output skin_and_bone.glb\n"
              "  isoscope export head.nii.gz --isovalue 60 --close --output print.stl\n"
              "  isoscope export large/ --isovalue 60 --level 2 --output coarse.ply\n"
              "  isoscope export organs.seg.nrrd --labels all --output organ-%l.stl\n"
              "  isoscope export --server localhost:50051 --isovalue 60 --output head.stl\n",
          .register_flags = RegisterExportFlags};
}

}  // namespace isoscope::cli
