// A server of HTTP/1.1 on 127.0.0.1 that answers as a test's script says: wrong, late, or not at all.
//
//   ScriptedServer server([&](const ServedRequest& request, ServedConnection* connection) {
//     connection->Send("HTTP/1.1 503 Busy\r\nContent-Length: 0\r\n\r\n");
//   });
//
// ServeObject is a script that does everything right: others begin with it, and change one thing.

#ifndef ISOSCOPE_TESTS_SUPPORT_SCRIPTED_SERVER_H_
#define ISOSCOPE_TESTS_SUPPORT_SCRIPTED_SERVER_H_

#include <atomic>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/strings/string_view.h"

#include "core/base/mutex.h"

namespace isoscope::testing {

struct ServedRequest {
  int index = 0;  // of all that the server got, from 0
  std::string method = {};
  std::string target = {};                          // "/path?query", as sent
  std::map<std::string, std::string> headers = {};  // names in lower case

  [[nodiscard]] std::string Header(const std::string& name) const {
    const auto found = headers.find(name);
    return found == headers.end() ? "" : found->second;
  }
};

// The side of the server. Thread-compatible.
class ServedConnection {
 public:
  virtual ~ServedConnection() = default;
  // False once the client has gone.
  virtual bool Send(absl::string_view bytes) = 0;
  // Ends the connection: in order, or by RST.
  virtual void Close() = 0;
  virtual void Reset() = 0;
  // Sends nothing until the client or the server ends the connection.
  virtual void Hang() = 0;
};

// A certificate of 127.0.0.1 that signs itself, and its key: PEM.
struct TestIdentity {
  std::string certificate;
  std::string key;
};
TestIdentity MakeTestIdentity();

// Thread-safe. Each connection has a thread of its own, which calls the script.
class ScriptedServer {
 public:
  using Script = std::function<void(const ServedRequest&, ServedConnection*)>;

  explicit ScriptedServer(Script script) : ScriptedServer(std::move(script), nullptr) {}
  // With TLS.
  ScriptedServer(Script script, const TestIdentity* identity);
  // Ends all connections.
  ~ScriptedServer();
  ScriptedServer(const ScriptedServer&) = delete;
  ScriptedServer& operator=(const ScriptedServer&) = delete;

  // "http://127.0.0.1:PORT"
  [[nodiscard]] std::string origin() const;
  [[nodiscard]] int port() const { return port_; }
  [[nodiscard]] std::vector<ServedRequest> requests() const;
  [[nodiscard]] int request_count() const { return static_cast<int>(requests().size()); }
  [[nodiscard]] int connection_count() const { return connection_count_; }

 private:
  class Connection;
  struct Tls;

  void Accept();
  void Serve(const std::shared_ptr<Connection>& connection);

  const Script script_;
  std::unique_ptr<Tls> tls_;
  int listener_ = -1;
  int port_ = 0;
  std::atomic<int> connection_count_{0};
  mutable base::Mutex mutex_;
  bool is_stopping_ ABSL_GUARDED_BY(mutex_) = false;
  std::vector<ServedRequest> requests_ ABSL_GUARDED_BY(mutex_);
  std::vector<std::shared_ptr<Connection>> connections_ ABSL_GUARDED_BY(mutex_);
  std::vector<std::thread> threads_;  // of connections: the accepting thread's until it ends
  std::thread accepting_;
};

// Bytes and version of an object.
struct ServedObject {
  std::string bytes;
  std::string etag = "\"v1\"";  // empty: none
};

// The range that a request asks of an object of `size` bytes: [first, last]; {0, -1} if there is no
// Range header, {-1, -1} for one that does not lie in the object.
std::pair<std::int64_t, std::int64_t> AskedRange(const ServedRequest& request, std::int64_t size);

// Answers by the rules: 200, 206, 412, 416.
void ServeObject(const ServedObject& object, const ServedRequest& request,
                 ServedConnection* connection);

// "HTTP/1.1 STATUS X\r\nHEADERS\r\nContent-Length: ...\r\n\r\nBODY"; `headers`: each with "\r\n".
std::string Answer(int status, absl::string_view headers, absl::string_view body);

}  // namespace isoscope::testing

#endif  // ISOSCOPE_TESTS_SUPPORT_SCRIPTED_SERVER_H_
