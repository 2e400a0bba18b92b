// isoscope export INPUT | DIR | --server HOST:PORT --isovalue V --output FILE

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <ostream>
#include <string>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/time/clock.h"

#include "client-cli/command.h"
#include "client-cli/flags.h"
#include "client-cli/mesh_components.h"
#include "client-cli/mesh_piece.h"
#include "client-cli/mesh_simplifier.h"
#include "client-cli/mesh_store.h"
#include "client-cli/mesh_writer.h"
#include "client-cli/no_surface.h"
#include "client-cli/output.h"
#include "client-cli/parse_value.h"
#include "client-cli/session.h"
#include "client-cli/usage.h"
#include "core/base/status_macros.h"

namespace isoscope::cli {
namespace {

struct ExportFlags {
  SessionFlags session;
  std::optional<double> isovalue;
  std::optional<std::string> output;
  std::optional<MeshFormat> format;
  std::optional<Color> color;
  std::optional<std::int64_t> min_component;
  std::optional<double> simplify_share;
  std::optional<double> simplify_error;

  // True if the whole mesh must be seen before it is written.
  [[nodiscard]] bool has_filter() const {
    return min_component || simplify_share || simplify_error;
  }
};

absl::StatusOr<double> ParseShare(absl::string_view text) {
  absl::StatusOr<double> share = ParseNumber(text);
  if (!share.ok() || *share <= 0 || *share >= 1) {
    return absl::InvalidArgumentError(
        absl::StrCat("'", text, "' is not a share of the triangles, above 0 and below 1"));
  }
  return share;
}

absl::StatusOr<MeshFileOptions> FileOptions(const ExportFlags& flags) {
  ISOSCOPE_RETURN_IF_ERROR(CheckUsage(flags.session));
  if (!flags.isovalue) {
    return UsageError("--isovalue V is missing: the level of the surface, in field units");
  }
  if (!flags.output) {
    return UsageError("--output FILE is missing: the mesh to write");
  }
  MeshFileOptions options{.path = *flags.output, .color = flags.color};
  ISOSCOPE_ASSIGN_OR_RETURN(options.format, MeshFormatOf(*flags.output, flags.format));
  ISOSCOPE_RETURN_IF_ERROR(CheckUsage(options));
  return options;
}

// Gives the stream of the isosurface to `sink`.
absl::Status Receive(const ExportFlags& flags, const std::string& dataset, Session* session,
                     MeshSink* sink, const Context& context) {
  isoscope::v1::ExportIsosurfaceRequest request;
  request.set_dataset(dataset);
  request.set_isovalue(*flags.isovalue);
  std::int64_t vertex_count = 0;
  std::int64_t triangle_count = 0;
  ProgressLine line(context.err, context.err_is_terminal);
  const auto add_chunk = [&](const isoscope::v1::ExportIsosurfaceResponse& chunk) -> absl::Status {
    line.Update(absl::StrCat("exporting  ", FormatCount(vertex_count), " vertices, ",
                             FormatCount(triangle_count), " triangles"));
    ISOSCOPE_ASSIGN_OR_RETURN(
        const MeshPiece piece,
        DecodeMeshPiece(chunk.positions(), chunk.normals(), chunk.triangles(), vertex_count));
    vertex_count += piece.vertex_count();
    triangle_count += piece.triangle_count();
    return sink->Add(piece);
  };
  return session->client().ExportIsosurface(request, session->timeout(), add_chunk);
}

// Drops islands and simplifies, and tells what it did.
absl::Status Filter(const ExportFlags& flags, MeshStore* mesh, const Context& context) {
  const std::int64_t all_count = mesh->triangle_count();
  if (flags.min_component) {
    ISOSCOPE_ASSIGN_OR_RETURN(const DroppedComponents dropped,
                              DropSmallComponents(*flags.min_component, mesh));
    *context.out << "dropped " << FormatCount(dropped.dropped_count) << " of "
                 << FormatCount(dropped.component_count) << " components, "
                 << FormatCount(dropped.dropped_triangle_count) << " of " << FormatCount(all_count)
                 << " triangles\n";
  }
  if (flags.simplify_share || flags.simplify_error) {
    const std::int64_t count = mesh->triangle_count();
    ProgressLine line(context.err, context.err_is_terminal);
    SimplifyOptions options{.share = flags.simplify_share, .max_error = flags.simplify_error};
    options.progress = [&](double done) {
      line.Update(absl::StrFormat("simplifying  %.0f %%", 100 * done));
      return context.interrupt->cancellation().Check();
    };
    ISOSCOPE_ASSIGN_OR_RETURN(const SimplifyResult result, SimplifyMesh(options, mesh));
    *context.out << "simplified " << FormatCount(count) << " triangles to "
                 << FormatCount(result.triangle_count)
                 << absl::StrFormat(", estimated error %.3g world units\n", result.error);
  }
  return absl::OkStatus();
}

absl::Status Run(const ExportFlags& flags, const Context& context) {
  ISOSCOPE_ASSIGN_OR_RETURN(const MeshFileOptions file_options, FileOptions(flags));
  ISOSCOPE_RETURN_IF_ERROR(CheckWritable(*flags.output));
  ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<Session> session,
                            Session::Open(flags.session, std::nullopt, context));
  ISOSCOPE_ASSIGN_OR_RETURN(
      const isoscope::v1::Dataset dataset,
      session->client().GetDataset(session->dataset_name(), session->timeout()));
  WarnIfNoSurface(dataset, *flags.isovalue, context);
  const absl::Time start = absl::Now();
  ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<MeshWriter> writer,
                            MeshWriter::Create(file_options));
  if (flags.has_filter()) {
    const std::string folder = std::filesystem::path(*flags.output).parent_path().string();
    ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<MeshStore> mesh,
                              MeshStore::Create(folder.empty() ? "." : folder));
    ISOSCOPE_RETURN_IF_ERROR(Receive(flags, dataset.name(), session.get(), mesh.get(), context));
    ISOSCOPE_RETURN_IF_ERROR(Filter(flags, mesh.get(), context));
    ISOSCOPE_RETURN_IF_ERROR(mesh->Emit(writer.get()));
  } else {
    ISOSCOPE_RETURN_IF_ERROR(Receive(flags, dataset.name(), session.get(), writer.get(), context));
  }
  ISOSCOPE_RETURN_IF_ERROR(writer->Finish());
  *context.out << *flags.output << ": " << FormatCount(writer->vertex_count()) << " vertices, "
               << FormatCount(writer->triangle_count()) << " triangles, "
               << FormatMebibytes(writer->size_bytes()) << ", in "
               << FormatElapsed(absl::Now() - start) << "\n";
  return absl::OkStatus();
}

Action RegisterFlags(CLI::App* app) {
  const auto flags = std::make_shared<ExportFlags>();
  AddSessionFlags(app, &flags->session);
  AddFlag(app, "--isovalue", "V", &flags->isovalue, ParseNumber, "the level, in field units");
  AddFlag(app, "--output", "FILE", &flags->output, ParseText,
          "the mesh; its suffix says the format: .ply (binary), .stl (binary), .obj, .glb, .vtp, "
          "all but STL with vertex normals. It goes to disk as it comes, in a few MiB of memory, "
          "whatever its size; a .stl, --min-component and --simplify use scratch files beside it, "
          "of which memory holds what the system leaves there, and --simplify some 200 MiB");
  AddFlag(app, "--format", "ply|stl|obj|glb|vtp", &flags->format, ParseMeshFormat,
          "the format, for a name without a suffix (default: ply)");
  AddFlag(app, "--color", "R,G,B", &flags->color, ParseColor,
          "colour of the surface, 0 to 1 each: of its vertices in PLY, OBJ and VTP, of its "
          "material in GLB (default: none)");
  AddFlag(
      app, "--min-component", "N", &flags->min_component,
      [](absl::string_view text) { return ParseInteger(text, 1, INT64_MAX); },
      "leave out islands of fewer than N triangles");
  AddFlag(app, "--simplify", "SHARE", &flags->simplify_share, ParseShare,
          "keep this share of the triangles, above 0 and below 1, without cracks");
  AddFlag(app, "--simplify-error", "E", &flags->simplify_error, ParsePositiveNumber,
          "remove triangles while the surface moves by no more than E world units, as "
          "libmeshoptimizer estimates it; with --simplify, whichever is first");
  return [flags](const Context& context) { return Run(*flags, context); };
}

}  // namespace

Command ExportCommand() {
  return {.name = "export",
          .summary = "Writes a whole isosurface as one welded mesh: PLY, STL, OBJ, GLB or VTP",
          .usage = "INPUT | DIR | --server HOST:PORT --isovalue V --output FILE [OPTIONS]",
          .examples =
              "  isoscope export head.nii.gz --isovalue 60 --output head.ply\n"
              "  isoscope export head.nii.gz --isovalue 60 --min-component 1000 --simplify 0.1 \\\n"
              "    --color 0.9,0.85,0.8 --output head.glb\n"
              "  isoscope export --server localhost:50051 --isovalue 60 --output head.stl\n",
          .register_flags = RegisterFlags};
}

}  // namespace isoscope::cli
