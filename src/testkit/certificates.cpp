#include "testkit/certificates.hpp"

#include <vector>

#include <gtest/gtest.h>

#include "testkit/process.hpp"

namespace gantry::testkit {

static void openssl(std::vector<std::string> arguments, const std::string& log) {
    arguments.insert(arguments.begin(), "/usr/bin/openssl");
    Process process(arguments, {}, log);
    ASSERT_EQ(process.wait(), 0) << "openssl failed, see " << log;
}

static std::vector<std::string> new_certificate(const std::string& key, const std::string& certificate,
                                                const std::string& name) {
    return {"req",    "-x509",   "-newkey",    "ec",   "-pkeyopt",  "ec_paramgen_curve:prime256v1",
            "-nodes", "-keyout", key,          "-out", certificate, "-days",
            "2",      "-subj",   "/CN=" + name};
}

Certificates::Certificates() {
    openssl(new_certificate(file("ca.key"), ca(), "authority of a test"), file("log"));
}

void Certificates::issue(const std::string& name, const std::string& subject_names) const {
    auto arguments = new_certificate(file(name + ".key"), file(name + ".pem"), name);
    for (auto& each : {std::string("-CA"), ca(), std::string("-CAkey"), file("ca.key"),
                       std::string("-addext"), "subjectAltName=" + subject_names, std::string("-addext"),
                       std::string("basicConstraints=critical,CA:FALSE")})
        arguments.push_back(each);
    openssl(arguments, file("log"));
}

}  // namespace gantry::testkit
