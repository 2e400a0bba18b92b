#include "partition-agent/supply/mesh_worker.h"

#include "core/base/scoped_timer.h"

namespace isoscope::agent {

absl::Status MeshWorker::AddTo(MeshSink* sink, const base::Cancellation& cancellation,
                               base::TraceRecorder* trace) {
  if (meshes.empty() || sink->is_full()) {
    return absl::OkStatus();
  }
  const base::TraceScope scope(trace, "draw");
  const base::ScopedTimer timer(&add_time);
  absl::Status status;
  std::size_t begin = 0;
  while (status.ok() && begin < meshes.size() && !sink->is_full()) {
    status = cancellation.Check();
    std::size_t end = begin;
    std::size_t bytes = 0;
    for (; end < meshes.size() && end - begin < kMaxBatchMeshes && bytes < kMaxBatchBytes; ++end) {
      bytes += meshes[end].mesh->size_bytes();
    }
    if (status.ok()) {
      status = sink->Add(std::span(meshes).subspan(begin, end - begin));
    }
    begin = end;
  }
  meshes.erase(meshes.begin(), meshes.begin() + static_cast<std::ptrdiff_t>(begin));
  mesh_bytes = 0;
  return status;
}

}  // namespace isoscope::agent
