// A port that a test's servers come back to.

#ifndef ISOSCOPE_TESTS_SUPPORT_HELD_PORT_H_
#define ISOSCOPE_TESTS_SUPPORT_HELD_PORT_H_

#include <unistd.h>

#include <cstdint>
#include <memory>
#include <string>

#include "absl/strings/str_cat.h"
#include <netinet/in.h>
#include <sys/socket.h>

namespace isoscope::testing {

// A port of 127.0.0.1 that is bound, but not listened on. The kernel does not assign it to other
// processes, but a server may still listen on it by its number (SO_REUSEADDR).
class HeldPort {
 public:
  // `port` 0: any free one. Null if the port is in use.
  static std::shared_ptr<const HeldPort> Bind(int port) {
    const int socket_fd = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    const int yes = 1;
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(static_cast<std::uint16_t>(port));
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    socklen_t size = sizeof(address);
    if (socket_fd < 0 || setsockopt(socket_fd, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof(yes)) != 0 ||
        bind(socket_fd, reinterpret_cast<const sockaddr*>(&address), size) != 0 ||
        getsockname(socket_fd, reinterpret_cast<sockaddr*>(&address), &size) != 0) {
      close(socket_fd);
      return nullptr;
    }
    return std::shared_ptr<const HeldPort>(new HeldPort(socket_fd, ntohs(address.sin_port)));
  }
  ~HeldPort() { close(socket_); }
  HeldPort(const HeldPort&) = delete;
  HeldPort& operator=(const HeldPort&) = delete;

  [[nodiscard]] int port() const { return port_; }
  [[nodiscard]] std::string address() const { return absl::StrCat("127.0.0.1:", port_); }

 private:
  HeldPort(int socket_fd, int port) : socket_(socket_fd), port_(port) {}

  const int socket_;
  const int port_;
};

}  // namespace isoscope::testing

#endif  // ISOSCOPE_TESTS_SUPPORT_HELD_PORT_H_
