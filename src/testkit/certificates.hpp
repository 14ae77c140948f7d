#pragma once
#include <string>

#include "testkit/temp_dir.hpp"

namespace gantry::testkit {

// An authority of the test's own, made by openssl, and what it vouches for. All are files; keys have no
// password.
class Certificates {
public:
    Certificates();
    // A certificate for these names, "IP:127.0.0.1,DNS:localhost": NAME.pem and NAME.key.
    void issue(const std::string& name, const std::string& subject_names) const;
    std::string ca() const { return file("ca.pem"); }
    std::string file(const std::string& name) const { return dir_.path() + "/" + name; }

private:
    TempDir dir_;
};

}  // namespace gantry::testkit
