// The socket that takes the connections of browsers.

#ifndef ISOSCOPE_CORE_HTTP_PEER_LISTENER_H_
#define ISOSCOPE_CORE_HTTP_PEER_LISTENER_H_

#include <functional>
#include <memory>
#include <string>

#include "absl/status/status.h"

#include "core/http/peer_stream.h"
#include "core/http/tls_context.h"

namespace isoscope::http {

// The listening socket and the threads of connections.
class PeerListener {
 public:
  // Called for each connection, one at a time; a stream that it does not keep is closed.
  using Serve = std::function<void(std::shared_ptr<PeerStream> stream)>;

  static std::unique_ptr<PeerListener> Make();
  // Ends the threads, and drops the remaining connections.
  virtual ~PeerListener() = default;

  // `host` has no brackets; port 0 takes a free one. `address`: both, for errors. `tls`: null for
  // plain TCP. UNAVAILABLE: the address can't be bound. Call it once.
  virtual absl::Status Listen(const std::string& host, const std::string& port,
                              const std::string& address, std::unique_ptr<TlsContext> tls,
                              int thread_count, Serve serve) = 0;
  [[nodiscard]] virtual int port() const = 0;
  // Takes no new connections.
  virtual void Close() = 0;
};

}  // namespace isoscope::http

#endif  // ISOSCOPE_CORE_HTTP_PEER_LISTENER_H_
