// The gateway's port: HTTP and WebSockets through Beast, over a real connection. The coordinator
// behind it answers nothing but errors.
//
//   0 the bytes are the connection       1 a WebSocket is open: each message is a byte, its opcode,
//                                          and a piece, which is masked and framed
//
// The gateway ends the connection once the client has ended its side. What it says is HTTP, and a
// good request is answered whatever came before.

#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include <arpa/inet.h>
#include <grpcpp/server_builder.h>
#include <netinet/in.h>
#include <sys/socket.h>

#include "rpc/channel.h"
#include "tests/fuzz/fuzz_input.h"
#include "web-gateway/gateway_server.h"

namespace isoscope::fuzz {
namespace {

constexpr int kPatienceSeconds = 60;
constexpr int kInputsBetweenGoodRequests = 64;
constexpr absl::string_view kUpgrade =
    "GET /v1/interact HTTP/1.1\r\nHost: localhost\r\nConnection: Upgrade\r\nUpgrade: websocket\r\n"
    "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n\r\n";

class Gateway {
 public:
  Gateway() {
    grpc::ServerBuilder builder;
    coordinator_ = builder.BuildAndStart();
    gateway::GatewayOptions options;
    options.channel = coordinator_->InProcessChannel(rpc::MakeChannelArguments());
    options.listen_address = "127.0.0.1:0";
    options.thread_count = 1;
    auto server = gateway::GatewayServer::Start(options);
    Require(server.ok(), "a gateway can be started");
    server_ = *std::move(server);
  }

  [[nodiscard]] int Connect() const {
    int client = TryConnect();
    while (client < 0 && errno == EINTR) {  // libFuzzer's alarm
      client = TryConnect();
    }
    Require(client >= 0, "the gateway takes connections");
    return client;
  }

 private:
  // -1 and errno: not now.
  [[nodiscard]] int TryConnect() const {
    const int client = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    const timeval patience{.tv_sec = kPatienceSeconds, .tv_usec = 0};
    setsockopt(client, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof(patience));
    setsockopt(client, SOL_SOCKET, SO_SNDTIMEO, &patience, sizeof(patience));
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(static_cast<std::uint16_t>(server_->port()));
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    if (connect(client, reinterpret_cast<const sockaddr*>(&address), sizeof(address)) == 0) {
      return client;
    }
    const int connect_errno = errno;
    close(client);
    errno = connect_errno;
    return -1;
  }

  std::unique_ptr<grpc::Server> coordinator_;
  std::unique_ptr<gateway::GatewayServer> server_;
};

Gateway& TheGateway() {
  static Gateway gateway;
  return gateway;
}

// Sends the bytes, ends this side, and returns the answer up to the gateway's end.
std::string Talk(absl::string_view bytes) {
  const int client = TheGateway().Connect();
  while (!bytes.empty()) {
    const ssize_t sent = send(client, bytes.data(), bytes.size(), MSG_NOSIGNAL);
    if (sent <= 0 && errno != EINTR) {
      break;  // the gateway has heard enough
    }
    bytes.remove_prefix(static_cast<std::size_t>(std::max<ssize_t>(sent, 0)));
  }
  shutdown(client, SHUT_WR);
  std::string answer;
  std::array<char, 4096> part{};
  ssize_t size = 0;
  // libFuzzer's alarm interrupts.
  while ((size = recv(client, part.data(), part.size(), 0)) > 0 || (size < 0 && errno == EINTR)) {
    answer.append(part.data(), static_cast<std::size_t>(std::max<ssize_t>(size, 0)));
  }
  Require(size == 0 || errno == ECONNRESET, "the gateway ends a connection that its client ended");
  close(client);
  return answer;
}

// A client's frame: final, masked with zeros.
std::string Frame(std::uint8_t opcode, absl::string_view payload) {
  std::string frame{static_cast<char>(0x80 | (opcode & 0x7f))};
  if (payload.size() < 126) {
    frame += static_cast<char>(0x80 | payload.size());
  } else {
    frame += static_cast<char>(0xfe);
    frame += static_cast<char>(payload.size() >> 8);
    frame += static_cast<char>(payload.size() & 0xff);
  }
  return absl::StrCat(frame, std::string(4, '\0'), payload);
}

void Run(Input input) {
  if (input.Byte() % 2 == 0) {
    const std::string answer = Talk(input.Rest());
    Require(answer.empty() || absl::StartsWith(answer, "HTTP/1."), "what is said is HTTP");
    return;
  }
  std::string bytes(kUpgrade);
  while (!input.empty()) {
    const std::uint8_t opcode = input.Byte();
    bytes += Frame(opcode, input.Piece());
  }
  Require(absl::StartsWith(Talk(bytes), "HTTP/1.1 101 "), "a WebSocket is opened");
}

void RequireGoodAnswer() {
  const std::string answer = Talk("GET / HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n");
  Require(absl::StartsWith(answer, "HTTP/1.1 200 "), "a good request is answered");
}

}  // namespace

std::vector<std::string> Seeds() {
  const std::string zero(1, '\0');
  const auto get = [&](const std::string& target, const std::string& fields) {
    return zero + "GET " + target + " HTTP/1.1\r\nHost: localhost\r\n" + fields + "\r\n";
  };
  return {
      get("/", ""),
      get("/v1/datasets", "Accept: */*\r\n") + "GET /healthz HTTP/1.1\r\nHost: localhost\r\n\r\n",
      get("/v1/datasets/head/render?isovalue=60&width=64&height=48",
          "traceparent: 00-4bf92f3577b34da6a3ce929d0e0e4736-00f067aa0ba902b7-01\r\n"),
      zero +
          "POST /v1/datasets/head/pick HTTP/1.1\r\nHost: localhost\r\nContent-Length: 2\r\n"
          "Content-Type: application/json\r\n\r\n{}",
      zero +
          "POST /v1/datasets/head/pick HTTP/1.1\r\nHost: localhost\r\n"
          "Transfer-Encoding: chunked\r\n\r\n2\r\n{}\r\n0\r\n\r\n",
      zero + "OPTIONS /v1/datasets HTTP/1.1\r\nHost: localhost\r\nOrigin: http://localhost\r\n\r\n",
      zero + std::string(kUpgrade) + Frame(1, "{}"),
      "\1\1" + MakePiece("{\"viewState\":{\"sequenceNumber\":\"1\",\"frame\":{\"isovalue\":60,"
                         "\"viewport\":{\"widthPx\":64,\"heightPx\":48}},\"isAtRest\":true}}"),
      "\1\1" + MakePiece("{\"frameShown\":{\"frameNumber\":\"7\"}}") + "\x9" + MakePiece("ping") +
          "\x8" + MakePiece("\x03\xe8"),
      "\1\2" + MakePiece("binary"),
  };
}

}  // namespace isoscope::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static int count = 0;
  isoscope::fuzz::Run(isoscope::fuzz::Input(data, size));
  if (count++ % isoscope::fuzz::kInputsBetweenGoodRequests == 0) {
    isoscope::fuzz::RequireGoodAnswer();
  }
  return 0;
}
