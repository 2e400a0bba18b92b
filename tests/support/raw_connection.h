// A client of TCP that sends what a test likes, from any loopback address, and reads with an end.

#ifndef ISOSCOPE_TESTS_SUPPORT_RAW_CONNECTION_H_
#define ISOSCOPE_TESTS_SUPPORT_RAW_CONNECTION_H_

#include <poll.h>
#include <unistd.h>

#include <array>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <string>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/string_view.h"
#include "absl/time/time.h"
#include "gtest/gtest.h"
#include <arpa/inet.h>
#include <netinet/in.h>
#include <sys/resource.h>
#include <sys/socket.h>

namespace isoscope::testing {

// Lets a test open as many files as the system allows.
inline void RaiseFileLimit() {
  rlimit limit{};
  getrlimit(RLIMIT_NOFILE, &limit);
  limit.rlim_cur = limit.rlim_max;
  setrlimit(RLIMIT_NOFILE, &limit);
}

// The port of "HOST:PORT".
inline int PortOf(const std::string& address) {
  return std::atoi(address.c_str() + address.rfind(':') + 1);
}

// Thread-compatible. Can be moved.
class RawConnection {
 public:
  // To 127.0.0.1; `source`: the own address, 127.a.b.c.
  explicit RawConnection(int port, const char* source = "127.0.0.1")
      : socket_(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0)) {
    EXPECT_GE(socket_, 0);
    const timeval patience{.tv_sec = 120, .tv_usec = 0};
    setsockopt(socket_, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof(patience));
    setsockopt(socket_, SOL_SOCKET, SO_SNDTIMEO, &patience, sizeof(patience));
    sockaddr_in own = AddressOf(source, 0);
    EXPECT_EQ(::bind(socket_, reinterpret_cast<const sockaddr*>(&own), sizeof(own)), 0) << source;
    sockaddr_in server = AddressOf("127.0.0.1", port);
    EXPECT_EQ(::connect(socket_, reinterpret_cast<const sockaddr*>(&server), sizeof(server)), 0);
  }
  ~RawConnection() { Close(); }
  RawConnection(RawConnection&& other) noexcept
      : socket_(std::exchange(other.socket_, -1)), unread_(std::move(other.unread_)) {}
  RawConnection& operator=(RawConnection&&) = delete;

  void Close() {
    if (socket_ >= 0) {
      ::close(std::exchange(socket_, -1));
    }
  }
  // False once the server has closed.
  bool Send(absl::string_view bytes) const {
    while (!bytes.empty()) {
      const ssize_t sent = ::send(socket_, bytes.data(), bytes.size(), MSG_NOSIGNAL);
      if (sent <= 0) {
        return false;
      }
      bytes.remove_prefix(static_cast<std::size_t>(sent));
    }
    return true;
  }
  // All that comes until the server closes.
  std::string ReadAll() {
    while (ReadMore()) {
    }
    return std::exchange(unread_, "");
  }
  // One answer of HTTP: its head, and the body that Content-Length names unless `is_of_head`.
  // Shorter if the server closes before its end.
  std::string ReadAnswer(bool is_of_head = false) {
    std::size_t end = std::string::npos;
    while ((end = unread_.find("\r\n\r\n")) == std::string::npos) {
      if (!ReadMore()) {
        return std::exchange(unread_, "");
      }
    }
    end += 4;
    const std::string head = absl::AsciiStrToLower(unread_.substr(0, end));
    const std::size_t length = head.find("\r\ncontent-length: ");
    if (length != std::string::npos && !is_of_head) {
      end += std::strtoul(head.c_str() + length + 18, nullptr, 10);
    }
    while (unread_.size() < end && ReadMore()) {
    }
    const std::string answer = unread_.substr(0, end);
    unread_.erase(0, end);
    return answer;
  }
  // Whether the server has closed by now.
  [[nodiscard]] bool IsClosed() const {
    char byte = 0;
    const ssize_t size = ::recv(socket_, &byte, 1, MSG_PEEK | MSG_DONTWAIT);
    return size == 0 || (size < 0 && errno != EAGAIN && errno != EWOULDBLOCK);
  }
  [[nodiscard]] int socket() const { return socket_; }

 private:
  static sockaddr_in AddressOf(const char* host, int port) {
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(static_cast<std::uint16_t>(port));
    EXPECT_EQ(inet_pton(AF_INET, host, &address.sin_addr), 1) << host;
    return address;
  }
  bool ReadMore() {
    std::array<char, 65536> piece{};
    const ssize_t size = ::recv(socket_, piece.data(), piece.size(), 0);
    unread_.append(piece.data(), static_cast<std::size_t>(size > 0 ? size : 0));
    return size > 0;
  }

  int socket_;
  std::string unread_;
};

}  // namespace isoscope::testing

#endif  // ISOSCOPE_TESTS_SUPPORT_RAW_CONNECTION_H_
