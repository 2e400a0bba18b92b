// WriteFlow:
//
//   1. Sum up the bytes of all files, and compare them with the free space.
//   2. Write each step to a partial file: header, fields, tail (docs/format/flow.md).
//   3. When all steps are complete, remove the old .pvd and rename the partial files.
//   4. Write the .pvd, which names the steps.
//
//   flow.pvd         the times and the names of the files
//   flow_00000.vti   XML; behind its underscore, for each field, a uint64 of its bytes and the
//                    float32 samples
//   flow_00001.vti   ...
//
// Invariant: a .pvd names complete files only. StepFiles removes what an unfinished call has made.

#include "core/synthetic/flow_file.h"

#include <array>
#include <charconv>
#include <cstddef>
#include <memory>

#include "absl/functional/function_ref.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_replace.h"
#include "absl/strings/string_view.h"

#include "core/base/coding.h"
#include "core/base/status_macros.h"
#include "core/io/atomic_file.h"
#include "core/io/file.h"
#include "core/synthetic/flow_generator.h"
#include "core/synthetic/generated_file.h"
#include "core/volume/grid_geometry.h"

namespace isoscope::source {
namespace {

constexpr char kEnding[] = ".pvd";
constexpr char kTail[] = "\n  </AppendedData>\n</VTKFile>\n";

// The shortest text that reads back as the same number.
std::string Text(double value) {
  std::array<char, 32> text;
  const std::to_chars_result result = std::to_chars(text.data(), text.data() + text.size(), value);
  return {text.data(), result.ptr};
}

std::string Text(const math::Vec3d& v) {
  return absl::StrCat(Text(v.x), " ", Text(v.y), " ", Text(v.z));
}

std::string Escaped(absl::string_view text) {
  return absl::StrReplaceAll(text,
                             {{"&", "&amp;"}, {"<", "&lt;"}, {">", "&gt;"}, {"\"", "&quot;"}});
}

std::string UnitsLabel(const char* unit) {
  return absl::StrCat("<InformationKey name=\"UNITS_LABEL\" location=\"vtkDataArray\">", unit,
                      "</InformationKey>");
}

std::int64_t RowBytes(const FlowFieldRow& field, const math::Index3& dims) {
  return dims.x * field.component_count * static_cast<std::int64_t>(sizeof(float));
}

std::int64_t FieldBytes(const FlowFieldRow& field, const math::Index3& dims) {
  return RowBytes(field, dims) * dims.y * dims.z;
}

// Returns the prefix of a field's samples: their size in bytes.
std::string LengthOf(const FlowFieldRow& field, const math::Index3& dims) {
  std::string text;
  base::AppendLittleEndian(static_cast<std::uint64_t>(FieldBytes(field, dims)), &text);
  return text;
}

std::string StepHeader(const volume::GridGeometry& grid, double time) {
  const math::Index3& dims = grid.sample_dims;
  const std::string extent = absl::StrFormat("0 %d 0 %d 0 %d", dims.x - 1, dims.y - 1, dims.z - 1);
  std::string text = absl::StrFormat(
      "<?xml version=\"1.0\"?>\n"
      "<VTKFile type=\"ImageData\" version=\"1.0\" byte_order=\"LittleEndian\" "
      "header_type=\"UInt64\">\n"
      "  <ImageData WholeExtent=\"%s\" Origin=\"%s\" Spacing=\"%s\" Unit=\"m\">\n"
      "    <FieldData>\n"
      "      <DataArray type=\"Float64\" Name=\"TimeValue\" NumberOfTuples=\"1\" Unit=\"s\" "
      "format=\"ascii\">\n"
      "        %s\n        %s\n"
      "      </DataArray>\n"
      "    </FieldData>\n"
      "    <Piece Extent=\"%s\">\n"
      "      <PointData Scalars=\"pressure\" Vectors=\"velocity\">\n",
      extent, Text(grid.origin), Text(grid.spacing), Text(time), UnitsLabel("s"), extent);
  std::int64_t offset = 0;
  for (const FlowFieldRow& field : kFlowFields) {
    absl::StrAppendFormat(
        &text,
        "        <DataArray type=\"Float32\" Name=\"%s\" NumberOfComponents=\"%d\"%s Unit=\"%s\" "
        "format=\"appended\" offset=\"%d\">\n"
        "          %s\n"
        "        </DataArray>\n",
        field.name, field.component_count,
        field.component_count == 3
            ? " ComponentName0=\"x\" ComponentName1=\"y\" ComponentName2=\"z\""
            : "",
        field.unit, offset, UnitsLabel(field.unit));
    offset += static_cast<std::int64_t>(sizeof(std::uint64_t)) + FieldBytes(field, dims);
  }
  absl::StrAppend(&text,
                  "      </PointData>\n"
                  "      <CellData/>\n"
                  "    </Piece>\n"
                  "  </ImageData>\n"
                  "  <AppendedData encoding=\"raw\">\n"
                  "   _");
  return text;
}

std::int64_t StepBytes(const volume::GridGeometry& grid, double time) {
  auto bytes = static_cast<std::int64_t>(StepHeader(grid, time).size() + sizeof(kTail) - 1);
  for (const FlowFieldRow& field : kFlowFields) {
    bytes += static_cast<std::int64_t>(sizeof(std::uint64_t)) + FieldBytes(field, grid.sample_dims);
  }
  return bytes;
}

absl::Status WriteStep(const volume::GridGeometry& grid, double time,
                       absl::FunctionRef<absl::Status(absl::string_view)> append,
                       const base::Cancellation& cancellation) {
  const math::Index3& dims = grid.sample_dims;
  const FlowInstant flow(grid, time);
  ISOSCOPE_RETURN_IF_ERROR(append(StepHeader(grid, time)));
  for (const FlowFieldRow& field : kFlowFields) {
    const RowSource rows{.row_count = dims.y * dims.z,
                         .row_bytes = RowBytes(field, dims),
                         .fill = [&](std::int64_t begin, std::int64_t end, char* out) {
                           flow.FillRows(field.field, begin, end, out);
                         }};
    ISOSCOPE_RETURN_IF_ERROR(append(LengthOf(field, dims)));
    ISOSCOPE_RETURN_IF_ERROR(AppendRows(rows, append, cancellation));
  }
  return append(kTail);
}

// The files of the steps: partial ones, until all get their names. Removes what it made unless
// Keep was called.
class StepFiles {
 public:
  explicit StepFiles(const FlowFileOptions& options)
      : stem_(options.path.substr(0, options.path.size() - (sizeof(kEnding) - 1))),
        time_step_(options.time_step),
        step_count_(options.step_count) {}
  StepFiles(const StepFiles&) = delete;
  StepFiles& operator=(const StepFiles&) = delete;
  ~StepFiles() {
    for (std::int64_t step = 0; step < made_count_; ++step) {
      const std::string path = Path(step);
      io::RemoveRecursively(step < named_count_ ? path : io::PartialName(path)).IgnoreError();
    }
  }

  [[nodiscard]] std::int64_t step_count() const { return step_count_; }
  [[nodiscard]] double Time(std::int64_t step) const {
    return static_cast<double>(step) * time_step_;
  }

  // Creates the partial file of the next step.
  absl::StatusOr<std::unique_ptr<io::WritableFile>> CreateNext() {
    const std::string path = Path(made_count_);
    ISOSCOPE_RETURN_IF_ERROR(CheckNoFolder(path));
    const std::string partial = io::PartialName(path);
    ISOSCOPE_RETURN_IF_ERROR(io::RemoveRecursively(partial));
    ++made_count_;
    return io::CreateWritableFile(partial);
  }

  absl::Status GiveNames() {
    for (; named_count_ < made_count_; ++named_count_) {
      const std::string path = Path(named_count_);
      ISOSCOPE_RETURN_IF_ERROR(io::RenamePath(io::PartialName(path), path));
    }
    return absl::OkStatus();
  }

  void Keep() { made_count_ = 0; }

  // The text of the .pvd.
  [[nodiscard]] std::string Collection() const {
    std::string text =
        "<?xml version=\"1.0\"?>\n"
        "<VTKFile type=\"Collection\" version=\"1.0\" byte_order=\"LittleEndian\" "
        "header_type=\"UInt64\">\n"
        "  <Collection TimeUnit=\"s\">\n";
    for (std::int64_t step = 0; step < step_count_; ++step) {
      const std::string path = Path(step);
      absl::StrAppend(&text, "    <DataSet timestep=\"", Text(Time(step)), "\" part=\"0\" file=\"",
                      Escaped(absl::string_view(path).substr(path.rfind('/') + 1)), "\"/>\n");
    }
    absl::StrAppend(&text, "  </Collection>\n</VTKFile>\n");
    return text;
  }

 private:
  [[nodiscard]] std::string Path(std::int64_t step) const {
    return absl::StrFormat("%s_%05d.vti", stem_, step);
  }

  const std::string stem_;
  const double time_step_;
  const std::int64_t step_count_;
  std::int64_t made_count_ = 0;   // steps, from the first on
  std::int64_t named_count_ = 0;  // of those
};

absl::Status CheckOptions(const FlowFileOptions& options) {
  ISOSCOPE_RETURN_IF_ERROR(CheckFlowPath(options.path));
  if (options.step_count < 1 || options.step_count > kMaxFlowSteps) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%d time steps: expected 1 to %d", options.step_count, kMaxFlowSteps));
  }
  const double last = static_cast<double>(options.step_count - 1) * options.time_step;
  if (!(options.time_step > 0) || !(last <= kMaxFlowTime)) {
    return absl::InvalidArgumentError(
        absl::StrFormat("time step %g s, last time %g s: expected more than 0, and at most %g",
                        options.time_step, last, kMaxFlowTime));
  }
  return absl::OkStatus();
}

}  // namespace

absl::Status CheckFlowPath(const std::string& path) {
  const std::string name = path.substr(path.rfind('/') + 1);
  if (!absl::EndsWithIgnoreCase(name, kEnding) || name.size() == sizeof(kEnding) - 1) {
    return absl::InvalidArgumentError(absl::StrCat(
        path, ": a flow is a series of time steps; expected a name that ends in .pvd"));
  }
  return absl::OkStatus();
}

absl::StatusOr<std::int64_t> WriteFlow(const FlowFileOptions& options,
                                       const base::Cancellation& cancellation) {
  ISOSCOPE_RETURN_IF_ERROR(CheckOptions(options));
  ISOSCOPE_ASSIGN_OR_RETURN(const volume::GridGeometry grid, FlowGrid(options.dims));
  ISOSCOPE_RETURN_IF_ERROR(CheckNoFolder(options.path));
  StepFiles steps(options);
  const std::string collection = steps.Collection();
  auto total_bytes = static_cast<std::int64_t>(collection.size());
  for (std::int64_t step = 0; step < steps.step_count(); ++step) {
    if (__builtin_add_overflow(total_bytes, StepBytes(grid, steps.Time(step)), &total_bytes)) {
      return absl::InvalidArgumentError(
          absl::StrFormat("%d steps of %d x %d x %d samples: more than any disk holds",
                          steps.step_count(), options.dims.x, options.dims.y, options.dims.z));
    }
  }
  ISOSCOPE_RETURN_IF_ERROR(CheckFreeSpace(options.path, total_bytes,
                                          "free some, or give smaller --dims or fewer --steps"));
  std::int64_t done_bytes = 0;
  for (std::int64_t step = 0; step < steps.step_count(); ++step) {
    ISOSCOPE_RETURN_IF_ERROR(cancellation.Check());
    ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<io::WritableFile> file, steps.CreateNext());
    const auto append = [&](absl::string_view bytes) {
      absl::Status status = file->Append(bytes);
      done_bytes += static_cast<std::int64_t>(bytes.size());
      if (options.progress) {
        options.progress(done_bytes, total_bytes);
      }
      return status;
    };
    ISOSCOPE_RETURN_IF_ERROR(WriteStep(grid, steps.Time(step), append, cancellation));
    ISOSCOPE_RETURN_IF_ERROR(file->Close());
  }
  ISOSCOPE_RETURN_IF_ERROR(cancellation.Check());
  ISOSCOPE_RETURN_IF_ERROR(io::RemoveRecursively(options.path));
  ISOSCOPE_RETURN_IF_ERROR(steps.GiveNames());
  ISOSCOPE_RETURN_IF_ERROR(io::WriteFileAtomically(options.path, collection));
  steps.Keep();
  return total_bytes;
}

}  // namespace isoscope::source
