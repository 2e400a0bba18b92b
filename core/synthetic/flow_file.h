// Writes a simulated flow as a ParaView collection: a .pvd, and a VTK ImageData file for each time
// step beside it.
//
//   flow.pvd                     <VTKFile type="Collection" ...>
//                                  <Collection TimeUnit="s">
//                                    <DataSet timestep="0.1" part="0" file="flow_00001.vti"/>
//   flow_00000.vti               <ImageData WholeExtent="0 63 ..." ... Unit="m">
//   flow_00001.vti                 <FieldData> <DataArray Name="TimeValue" Unit="s" ...>
//   ...                            <DataArray Name="pressure" Unit="Pa" ... offset="0"/>
//                                <AppendedData encoding="raw">_ [bytes, UInt64] [samples] ...
//
// Units stand where VTK keeps them, in the information key UNITS_LABEL of an array, and once more
// in an attribute `Unit` of its tag, for readers of tags. VTK has no place for the units of time in
// a collection and of lengths: the attributes TimeUnit of Collection and Unit of ImageData are
// ours. VTK passes over such attributes.
//
// Source: VTK's file format description, "XML File Formats", https://docs.vtk.org.

#ifndef ISOSCOPE_CORE_SYNTHETIC_FLOW_FILE_H_
#define ISOSCOPE_CORE_SYNTHETIC_FLOW_FILE_H_

#include <cstdint>
#include <functional>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

#include "core/base/cancellation.h"
#include "core/math/vec.h"

namespace isoscope::source {

inline constexpr std::int64_t kMaxFlowSteps = 100000;

struct FlowFileOptions {
  std::string path;  // ends in .pvd; steps go to the same name with _00000.vti and so on
  math::Index3 dims;
  std::int64_t step_count = 1;  // 1 .. kMaxFlowSteps
  double time_step = 0.1;       // s between steps, of which the first is at 0; > 0
  // Bytes written and to be written; may be null; called by one thread at a time.
  std::function<void(std::int64_t done_bytes, std::int64_t total_bytes)> progress{};
};

// INVALID_ARGUMENT if the name does not end in .pvd.
absl::Status CheckFlowPath(const std::string& path);

// Generates in parallel and writes front to back, in constant memory (as AppendRows, and 24 bytes
// for each sample of the axes' sum). Crash-safe: all steps are written to "<name>.partial-<pid>"
// and flushed. Then a collection of that name is removed, the steps get their names, and the .pvd
// is written last: it never names a step that is missing or of another flow. An error or a
// cancellation leaves nothing.
//
// INVALID_ARGUMENT: options out of range. FAILED_PRECONDITION: a folder has one of the names.
// RESOURCE_EXHAUSTED: the disk is full, or would be (asked before the first byte). Returns the
// bytes of all files.
absl::StatusOr<std::int64_t> WriteFlow(const FlowFileOptions& options,
                                       const base::Cancellation& cancellation);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SYNTHETIC_FLOW_FILE_H_
