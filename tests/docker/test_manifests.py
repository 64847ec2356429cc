"""The examples for compose and Kubernetes: valid by their schemas, and in agreement with the images and settings."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import kubernetes_validate
import pytest
import yaml

from service.settings import Settings
from tests.conftest import ROOT
from tests.docker.test_dockerfiles import reader

DOCKER = ROOT / "docker"
MANIFESTS = sorted((DOCKER / "kubernetes").glob("*.yaml"))
SETTINGS = {f"SHAPE_CONCEPTS_{name.upper()}" for name in Settings.model_fields}
OTHERS = {"AWS_ENDPOINT_URL", "AWS_REGION", "AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY", "OMP_NUM_THREADS"}
PASSWORD = re.compile(r"(?i)(password|secret)")


def compose() -> dict[str, Any]:
    read: dict[str, Any] = yaml.safe_load((DOCKER / "compose.yaml").read_text())
    return read


def documents(*kinds: str) -> Iterator[dict[str, Any]]:
    """The objects of these kinds in all manifests; of every kind if none is named."""
    for file in MANIFESTS:
        for document in yaml.safe_load_all(file.read_text()):
            if not kinds or document["kind"] in kinds:
                yield document


def of_kind(kind: str, component: str) -> dict[str, Any]:
    return next(document for document in documents(kind) if document["metadata"]["name"].endswith(component))


def test_compose_is_valid_by_its_schema(tmp_path: Path) -> None:
    def checked(file: Path) -> int:
        command = [sys.executable, "-m", "check_jsonschema", "--builtin-schema", "vendor.compose-spec", str(file)]
        return subprocess.run(command, capture_output=True, timeout=60, check=False).returncode

    assert checked(DOCKER / "compose.yaml") == 0
    wrong = tmp_path / "compose.yaml"
    wrong.write_text((DOCKER / "compose.yaml").read_text().replace("healthcheck:", "health_check:"))
    assert checked(wrong) != 0


@pytest.mark.parametrize("file", MANIFESTS, ids=lambda file: file.name)
def test_a_manifest_is_valid_by_kubernetes_own_schemas(file: Path) -> None:
    for document in yaml.safe_load_all(file.read_text()):
        kubernetes_validate.validate(document, "1.37", strict=True)
        wrong = document | {"specification": {}}
        with pytest.raises(kubernetes_validate.ValidationError):
            kubernetes_validate.validate(wrong, "1.37", strict=True)


def test_no_secret_stands_in_a_file() -> None:
    given = [service.get("environment", {}) for service in compose()["services"].values()]
    secrets = [(name, value) for each in given for name, value in each.items() if PASSWORD.search(name)]
    assert secrets
    assert all(value.startswith("${") for _, value in secrets)
    assert all("${POSTGRES_PASSWORD" in each["SHAPE_CONCEPTS_JOBS_URL"] for each in given if "AWS_REGION" in each)
    for document in documents("Secret"):
        assert all("CHANGE-ME" in text or "example" in text for text in document["stringData"].values())


def test_every_variable_that_is_asked_for_is_in_the_example_of_the_environment() -> None:
    asked = set(re.findall(r"\$\{([A-Z0-9_]+)", (DOCKER / "compose.yaml").read_text()))
    offered = {
        line.partition("=")[0] for line in (DOCKER / "compose.env.example").read_text().splitlines() if "=" in line
    }
    assert asked == offered


def test_every_setting_that_is_given_exists() -> None:
    given = [set(service.get("environment", {})) for service in compose()["services"].values()]
    for document in documents("Deployment"):
        for container in document["spec"]["template"]["spec"]["containers"]:
            given.append({variable["name"] for variable in container["env"]})
    given += [set(document.get("data", {})) | set(document.get("stringData", {})) for document in documents()]
    ours = {name for names in given for name in names if name.startswith(("SHAPE_CONCEPTS_", "AWS_", "OMP_"))}
    assert len(ours) > 10
    assert ours <= SETTINGS | OTHERS


@pytest.mark.parametrize("component", ["api", "router", "worker"])
def test_a_pod_is_what_its_image_is(component: str) -> None:
    image = reader().read(DOCKER / f"{'worker' if component == 'worker' else 'api'}.Dockerfile")[-1]
    pod = of_kind("Deployment", component)["spec"]["template"]["spec"]
    user, group = map(int, image.said("USER")[-1].split(":"))
    assert (pod["securityContext"]["runAsUser"], pod["securityContext"]["runAsGroup"]) == (user, group)
    assert pod["securityContext"]["runAsNonRoot"]
    # Variables of services, SHAPE_CONCEPTS_ROUTER_PORT and so on, would be taken for settings.
    assert pod["enableServiceLinks"] is False
    for container in pod["containers"]:
        assert container["securityContext"]["allowPrivilegeEscalation"] is False
        assert {"requests", "limits"} <= set(container["resources"])


def test_where_the_root_is_read_only_the_kernels_lie_where_they_are_looked_for() -> None:
    kernels = reader().read(DOCKER / "api.Dockerfile")[-1].environment()["NUMBA_CACHE_DIR"]
    pod = of_kind("Deployment", "api")["spec"]["template"]["spec"]
    (first,), (api,) = pod["initContainers"], pod["containers"]
    assert api["securityContext"]["readOnlyRootFilesystem"]
    assert first["command"] == ["cp", "--recursive", f"{kernels}/.", first["volumeMounts"][0]["mountPath"]]
    mounted = {mount["mountPath"]: mount["name"] for mount in api["volumeMounts"]}
    assert mounted[kernels] == first["volumeMounts"][0]["name"]
    assert {"/tmp", "/data"} <= set(mounted)


def test_services_budgets_and_scalers_find_their_pods() -> None:
    labels = {d["metadata"]["name"]: d["spec"]["template"]["metadata"]["labels"] for d in documents("Deployment")}
    for document in documents("Service"):
        assert document["spec"]["selector"] == labels[document["metadata"]["name"]]
    for document in documents("PodDisruptionBudget"):
        assert document["spec"]["selector"]["matchLabels"] == labels[document["metadata"]["name"]]
    for document in documents("HorizontalPodAutoscaler"):
        assert document["spec"]["scaleTargetRef"]["name"] in labels
        assert "replicas" not in of_kind("Deployment", "api")["spec"]  # it would undo what the scaler did


def test_requests_under_way_have_the_time_that_the_service_gives_them() -> None:
    from service.main import GRACE

    pod = of_kind("Deployment", "api")["spec"]["template"]["spec"]
    pause = pod["containers"][0]["lifecycle"]["preStop"]["sleep"]["seconds"]
    assert pod["terminationGracePeriodSeconds"] > GRACE + pause
    assert int(compose()["services"]["api"]["stop_grace_period"].removesuffix("s")) > GRACE
