// isoscope export INPUT | DIR | --server HOST:PORT --isovalue V --output FILE.ply

#include <memory>
#include <optional>
#include <ostream>
#include <string>

#include "absl/strings/str_cat.h"
#include "absl/time/clock.h"

#include "client-cli/command.h"
#include "client-cli/flags.h"
#include "client-cli/no_surface.h"
#include "client-cli/output.h"
#include "client-cli/parse_value.h"
#include "client-cli/ply_writer.h"
#include "client-cli/session.h"
#include "client-cli/usage.h"
#include "core/base/status_macros.h"

namespace isoscope::cli {
namespace {

struct ExportFlags {
  SessionFlags session;
  std::optional<double> isovalue;
  std::optional<std::string> output;
};

absl::Status CheckUsage(const ExportFlags& flags) {
  ISOSCOPE_RETURN_IF_ERROR(CheckUsage(flags.session));
  if (!flags.isovalue) {
    return UsageError("--isovalue V is missing: the level of the surface, in field units");
  }
  if (!flags.output) {
    return UsageError("--output FILE.ply is missing: the mesh to write");
  }
  return CheckSuffix(*flags.output, ".ply", "PLY");
}

absl::Status Run(const ExportFlags& flags, const Context& context) {
  ISOSCOPE_RETURN_IF_ERROR(CheckUsage(flags));
  ISOSCOPE_RETURN_IF_ERROR(CheckWritable(*flags.output));
  ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<Session> session,
                            Session::Open(flags.session, std::nullopt, context));
  ISOSCOPE_ASSIGN_OR_RETURN(
      const isoscope::v1::Dataset dataset,
      session->client().GetDataset(session->dataset_name(), session->timeout()));
  WarnIfNoSurface(dataset, *flags.isovalue, context);
  const absl::Time start = absl::Now();
  ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<PlyWriter> writer,
                            PlyWriter::Create(*flags.output));
  isoscope::v1::ExportIsosurfaceRequest request;
  request.set_dataset(dataset.name());
  request.set_isovalue(*flags.isovalue);
  {
    ProgressLine line(context.err, context.err_is_terminal);
    const auto write_chunk = [&](const isoscope::v1::ExportIsosurfaceResponse& chunk) {
      line.Update(absl::StrCat("exporting  ", FormatCount(writer->vertex_count()), " vertices, ",
                               FormatCount(writer->triangle_count()), " triangles"));
      return writer->AddChunk(chunk.positions(), chunk.normals(), chunk.triangles());
    };
    ISOSCOPE_RETURN_IF_ERROR(
        session->client().ExportIsosurface(request, session->timeout(), write_chunk));
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
  AddFlag(app, "--output", "FILE.ply", &flags->output, ParseText,
          "the mesh: binary PLY with vertex normals");
  return [flags](const Context& context) { return Run(*flags, context); };
}

}  // namespace

Command ExportCommand() {
  return {.name = "export",
          .summary = "Writes a whole isosurface as one welded mesh (PLY)",
          .usage = "INPUT | DIR | --server HOST:PORT --isovalue V --output FILE.ply [OPTIONS]",
          .examples =
              "  isoscope export head.nii.gz --isovalue 60 --output head.ply\n"
              "  isoscope export --server localhost:50051 --isovalue 60 --output head.ply\n",
          .register_flags = RegisterFlags};
}

}  // namespace isoscope::cli
