// The HTTP interface without its transport (docs/gateway.md): takes requests, calls the
// coordinator, and returns answers.

#ifndef ISOSCOPE_WEB_GATEWAY_API_API_H_
#define ISOSCOPE_WEB_GATEWAY_API_API_H_

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "core/base/executor.h"
#include "web-gateway/api/coordinator_client.h"
#include "web-gateway/api/mesh_budget.h"
#include "web-gateway/api/request_scope.h"
#include "web-gateway/http/http_message.h"

namespace isoscope::gateway {

struct ApiOptions {
  // Pictures, picks, meshes and films in work at a time; more are answered with 429.
  int max_pictures = 16;
  // Meshes and films of a caller, until they are sent; more are answered with 429.
  int max_caller_meshes = 2;
  // Disk space of all meshes and films, until they are sent; one that needs more is answered with 429.
  std::int64_t max_mesh_bytes = std::int64_t{2} << 30;
  // True if answers are for one user, so that no shared cache keeps them.
  bool is_private = false;
  // True if users' tokens are the coordinator's.
  bool passes_tokens = false;
  // Origins of pages that may have the page in a frame.
  std::vector<std::string> framing_origins = {};
};

// Thread-safe.
class Api {
 public:
  using Respond = std::function<void(HttpResponse)>;

  // `client` outlives it, and all calls have ended before it is destroyed. Its answers are sent, or
  // dropped, before that.
  Api(ApiOptions options, CoordinatorClient* client)
      : options_(std::move(options)),
        client_(client),
        meshes_(options_.max_caller_meshes, options_.max_mesh_bytes),
        drawing_(std::make_unique<base::Executor>(
            /*thread_count=*/1, static_cast<std::size_t>(options_.max_pictures))) {}

  // Answers: calls `respond` once, on this thread or on one of gRPC's. When the cancellation fires,
  // the work stops, and the answer follows soon.
  void Answer(HttpRequest request, std::shared_ptr<RequestScope> cancellation, Respond respond);

  // Waits until the pictures in work are drawn over and answered. No call of Answer follows, requests
  // are cancelled, and all calls to the coordinator have ended. A film may have begun another call,
  // which ends at once: wait for calls again.
  void FinishDrawing() { drawing_.reset(); }

  [[nodiscard]] int pictures_in_work() const { return pictures_in_work_.load(); }

 private:
  const ApiOptions options_;
  CoordinatorClient* const client_;
  MeshBudget meshes_;
  std::atomic<int> pictures_in_work_{0};
  std::unique_ptr<base::Executor> drawing_;  // over pictures; ends first, as its tasks use the rest
};

}  // namespace isoscope::gateway

#endif  // ISOSCOPE_WEB_GATEWAY_API_API_H_
