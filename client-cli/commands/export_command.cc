// isoscope export INPUT | DIR | --server HOST:PORT --isovalue V --output FILE
//
// 1. CheckUsage checks the flags against each other and the format of the file.
// 2. Without a filter, chunks go from the stream straight into the writer: memory stays constant.
// 3. With a filter (small components, simplification), SurfaceStores keeps each surface as a whole.
//    Filter processes one surface at a time, and the writer gets the result.

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

#include "client-cli/commands/program.h"
#include "client-cli/commands/surface_notes.h"
#include "client-cli/session/session.h"
#include "clients/cpp/connection/label_query.h"
#include "clients/cpp/connection/mesh_export.h"
#include "clients/cpp/connection/service_client.h"
#include "clients/cpp/mesh_file/mesh_components.h"
#include "clients/cpp/mesh_file/mesh_piece.h"
#include "clients/cpp/mesh_file/mesh_simplifier.h"
#include "clients/cpp/mesh_file/mesh_store.h"
#include "clients/cpp/mesh_file/mesh_writer.h"
#include "clients/cpp/request/clip_flags.h"
#include "clients/cpp/request/parse_value.h"
#include "clients/cpp/request/render_request.h"
#include "clients/cpp/request/selection_flags.h"
#include "core/base/monotonic_time.h"
#include "core/base/status_macros.h"
#include "core/cli/flags.h"
#include "core/cli/format.h"
#include "core/cli/progress_line.h"
#include "core/cli/usage.h"
#include "core/io/atomic_file.h"
#include "isoscope/v1/dataset.pb.h"
#include "isoscope/v1/isosurface_service.pb.h"

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
  std::optional<std::int64_t> min_component;
  std::optional<double> simplify_share;
  std::optional<double> simplify_error;
  std::optional<std::string> dataset_id;

  // Returns true if the whole mesh must be complete before it is written.
  [[nodiscard]] bool has_filter() const {
    return min_component || simplify_share || simplify_error;
  }
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
    if (list.empty()) {
      list.push_back({.name = "label"});  // the dataset tells which
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
  ISOSCOPE_RETURN_IF_ERROR(
      client::CheckSurfaces(flags.isovalue, flags.surfaces, flags.color, flags.label));
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
  ISOSCOPE_RETURN_IF_ERROR(CheckUsage(flags.selection));
  return CheckUsage(flags.clip);
}

absl::StatusOr<client::MeshFileOptions> FileOptions(const ExportFlags& flags) {
  ISOSCOPE_RETURN_IF_ERROR(CheckUsage(flags));
  client::MeshFileOptions options{.path = *flags.output, .surfaces = flags.mesh_surfaces()};
  const absl::StatusOr<client::MeshFormat> format =
      client::MeshFormatOf(*flags.output, flags.format);
  ISOSCOPE_RETURN_IF_ERROR(AsUsageError(format.status()));
  options.format = *format;
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
  return request;
}

// Stores each surface by itself, so that a filter of whole meshes processes one surface.
class SurfaceStores : public client::MeshSink {
 public:
  explicit SurfaceStores(std::string folder) : folder_(std::move(folder)) {}

  absl::Status Add(const client::MeshPiece& piece) override {
    while (stores_.size() <= static_cast<std::size_t>(piece.surface_index)) {
      first_vertex_ = vertex_count_;
      ISOSCOPE_ASSIGN_OR_RETURN(stores_.emplace_back(), client::MeshStore::Create(folder_));
    }
    vertex_count_ += piece.vertex_count();
    if (first_vertex_ == 0) {
      return stores_.back()->Add(piece);
    }
    client::MeshPiece own = piece;
    for (std::uint32_t& vertex : own.triangles) {
      vertex -= static_cast<std::uint32_t>(first_vertex_);
    }
    return stores_.back()->Add(own);
  }
  absl::Status Finish() override { return absl::OkStatus(); }

  [[nodiscard]] const std::vector<std::unique_ptr<client::MeshStore>>& stores() const {
    return stores_;
  }

  absl::Status Emit(client::MeshWriter* writer) const {
    for (std::size_t i = 0; i < stores_.size(); ++i) {
      ISOSCOPE_RETURN_IF_ERROR(
          stores_[i]->Emit(writer, writer->vertex_count(), static_cast<int>(i)));
    }
    return absl::OkStatus();
  }

 private:
  const std::string folder_;
  std::vector<std::unique_ptr<client::MeshStore>> stores_;  // by surface index
  std::int64_t first_vertex_ = 0;                           // first vertex of the last surface
  std::int64_t vertex_count_ = 0;
};

// Passes the stream of the isosurfaces to `sink`.
absl::Status Receive(const isoscope::v1::ExportIsosurfaceRequest& request, Session* session,
                     client::MeshSink* sink, const Context& context) {
  ProgressLine line(context.err, context.err_is_terminal);
  return client::ReceiveMesh(
      request, session->export_timeout(), &session->client(), sink,
      [&](std::int64_t vertex_count, std::int64_t triangle_count) {
        line.Update(absl::StrCat("exporting  ", FormatCount(vertex_count), " vertices, ",
                                 FormatCount(triangle_count), " triangles"));
      });
}

absl::Status DropIslands(std::int64_t min_triangles, const SurfaceStores& surfaces,
                         const Context& context) {
  std::int64_t triangle_count = 0;
  client::DroppedComponents sum;
  for (const std::unique_ptr<client::MeshStore>& mesh : surfaces.stores()) {
    triangle_count += mesh->triangle_count();
    ISOSCOPE_ASSIGN_OR_RETURN(const client::DroppedComponents dropped,
                              client::DropSmallComponents(min_triangles, mesh.get()));
    sum.component_count += dropped.component_count;
    sum.dropped_count += dropped.dropped_count;
    sum.dropped_triangle_count += dropped.dropped_triangle_count;
  }
  *context.out << "dropped " << FormatCount(sum.dropped_count) << " of "
               << FormatCount(sum.component_count) << " components, "
               << FormatCount(sum.dropped_triangle_count) << " of " << FormatCount(triangle_count)
               << " triangles\n";
  return absl::OkStatus();
}

absl::Status Simplify(const ExportFlags& flags, const SurfaceStores& surfaces,
                      const Context& context) {
  ProgressLine line(context.err, context.err_is_terminal);
  std::int64_t count = 0;
  client::SimplifyResult sum;
  for (std::size_t i = 0; i < surfaces.stores().size(); ++i) {
    client::MeshStore* const mesh = surfaces.stores()[i].get();
    count += mesh->triangle_count();
    client::SimplifyOptions options{.share = flags.simplify_share,
                                    .max_error = flags.simplify_error};
    options.progress = [&](double done) {
      line.Update(absl::StrFormat(
          "simplifying  %.0f %%",
          100 * (static_cast<double>(i) + done) / static_cast<double>(surfaces.stores().size())));
      return context.interrupt->cancellation().Check();
    };
    ISOSCOPE_ASSIGN_OR_RETURN(const client::SimplifyResult result,
                              client::SimplifyMesh(options, mesh));
    sum.triangle_count += result.triangle_count;
    sum.error = std::max(sum.error, result.error);
  }
  *context.out << "simplified " << FormatCount(count) << " triangles to "
               << FormatCount(sum.triangle_count)
               << absl::StrFormat(", estimated error %.3g world units\n", sum.error);
  return absl::OkStatus();
}

// Removes small components and simplifies, each surface by itself, and reports the counts.
absl::Status Filter(const ExportFlags& flags, const SurfaceStores& surfaces,
                    const Context& context) {
  if (flags.min_component) {
    ISOSCOPE_RETURN_IF_ERROR(DropIslands(*flags.min_component, surfaces, context));
  }
  return flags.simplify_share || flags.simplify_error ? Simplify(flags, surfaces, context)
                                                      : absl::OkStatus();
}

absl::Status Run(const ExportFlags& given, const Context& context) {
  ExportFlags flags = given;
  ISOSCOPE_ASSIGN_OR_RETURN(client::MeshFileOptions file_options, FileOptions(flags));
  ISOSCOPE_RETURN_IF_ERROR(io::CheckWritable(*flags.output));
  const WantedVolumes wanted{.selection = flags.selection};
  ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<Session> session,
                            Session::Open(flags.session, &wanted, std::nullopt, context));
  ISOSCOPE_ASSIGN_OR_RETURN(
      const isoscope::v1::Dataset dataset,
      session->client().GetDataset(session->dataset_name(), session->question_timeout()));
  session->AdaptSelection(&flags.selection);
  ISOSCOPE_RETURN_IF_ERROR(client::ResolveNames(dataset, &flags.selection));
  ISOSCOPE_RETURN_IF_ERROR(client::ResolveLabels(
      dataset, flags.selection, session->question_timeout(), &session->client(), &flags.label));
  ISOSCOPE_ASSIGN_OR_RETURN(file_options, FileOptions(flags));
  isoscope::v1::ExportIsosurfaceRequest request = MakeRequest(flags, dataset.name());
  file_options.field = client::PinSelection(dataset, &request);
  const base::MonotonicTime start = base::MonotonicNow();
  ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<client::MeshWriter> writer,
                            client::MeshWriter::Create(file_options));
  std::optional<SurfaceCounter> counter;
  if (flags.has_filter()) {
    const std::string folder = std::filesystem::path(*flags.output).parent_path().string();
    SurfaceStores surfaces(folder.empty() ? "." : folder);
    counter.emplace(&surfaces);
    ISOSCOPE_RETURN_IF_ERROR(Receive(request, session.get(), &*counter, context));
    ISOSCOPE_RETURN_IF_ERROR(Filter(flags, surfaces, context));
    ISOSCOPE_RETURN_IF_ERROR(surfaces.Emit(writer.get()));
  } else {
    counter.emplace(writer.get());
    ISOSCOPE_RETURN_IF_ERROR(Receive(request, session.get(), &*counter, context));
  }
  ISOSCOPE_RETURN_IF_ERROR(writer->Finish());
  *context.out << *flags.output << ": " << FormatCount(writer->vertex_count()) << " vertices, "
               << FormatCount(writer->triangle_count()) << " triangles, "
               << FormatMebibytes(writer->size_bytes()) << ", in "
               << FormatElapsed(base::MonotonicNow() - start) << "\n";
  return WriteNotesOnMesh(request, *counter, session.get(), context);
}

Action RegisterExportFlags(FlagSet* set) {
  const auto flags = std::make_shared<ExportFlags>();
  AddSessionFlags(set, &flags->session, "--input-format");
  AddFlag(set, "--isovalue", "V", &flags->isovalue, client::ParseNumber,
          "the level, in field units");
  AddRepeatableFlag(set, "--surface", "V[:COLOR]", &flags->surfaces, client::ParseSurface,
                    "a surface: its level and colour; instead of --isovalue and --color, up to 128 "
                    "times. All go into one file: as primitives with materials in GLB, as objects "
                    "in OBJ, with a surface index of vertices in PLY and VTP");
  client::AddLabelFlags(set, &flags->label, /*has_opacity=*/false);
  client::AddClipFlags(set, &flags->clip, "export");
  client::AddSelectionFlags(set, &flags->selection);
  AddFlag(set, "-o,--output", "FILE", &flags->output, ParseText,
          "the mesh; its suffix says the format: .ply (binary), .stl (binary), .obj, .glb, .vtp, "
          "all but STL with vertex normals. It goes to disk as it comes, in a few MiB of memory, "
          "whatever its size; a .stl, --min-component and --simplify use scratch files beside it, "
          "of which memory holds what the system leaves there, and --simplify some 200 MiB");
  AddFlag(set, "--format", "ply|stl|obj|glb|vtp", &flags->format, client::ParseMeshFormat,
          "the format, for a name without a suffix (default: ply)");
  AddFlag(set, "--color", "COLOR", &flags->color, client::ParseColor,
          "colour of the surface, a name of CSS as teal, #RRGGBB, or R,G,B from 0 to 1: of its "
          "vertices in PLY, OBJ and VTP, of its "
          "material in GLB (default: none)");
  AddFlag(
      set, "--min-component", "N", &flags->min_component,
      [](absl::string_view text) { return client::ParseInteger(text, 1, INT64_MAX); },
      "leave out islands of fewer than N triangles, as they are once clipped");
  AddFlag(set, "--simplify", "SHARE", &flags->simplify_share, ParseShare,
          "keep this share of the triangles of each surface, above 0 and below 1, without cracks");
  AddFlag(set, "--simplify-error", "E", &flags->simplify_error, client::ParsePositiveNumber,
          "remove triangles while the surface moves by no more than E world units, as "
          "libmeshoptimizer estimates it; with --simplify, whichever is first");
  AddFlag(set, "--dataset-id", "ID", &flags->dataset_id, ParseText,
          "fail if the dataset under that name has another id; `isoscope info` prints it");
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
              "  isoscope export head.nii.gz --isovalue 60 --min-component 1000 --simplify 0.1 \\\n"
              "    --color 0.9,0.85,0.8 --output head.glb\n"
              "  isoscope export head.nii.gz --surface 30:0.9,0.7,0.6 --surface 75:1,1,0.9 \\\n"
              "    --clip-plane 1,0,0,40 --output skin_and_bone.glb\n"
              "  isoscope export --server localhost:50051 --isovalue 60 --output head.stl\n",
          .register_flags = RegisterExportFlags};
}

}  // namespace isoscope::cli
