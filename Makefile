# make setup   .venv with the package, its Jazzy wheels and the tools      make test   lint, types, tests
# make demo    the arm live, an MCAP log and plots in demo/                make lint   only lint and types
# make docs    the site of docs/ in build/site/; a warning is an error
# make test-all   every scene of tests of which make test runs some, see test/sampled.py: six minutes more
# make test-fast   under a minute, without ROS: at every save
# make test-noble   what a robot with Ubuntu 24.04 runs, with the versions that it has; needs Python 3.12. Not in
#             .ci/run: a second environment and ten minutes are more than there is time for
# make robot   the README's commands for a robot beside Ubuntu 24.04's packages, told in build/robot.txt; needs Python 3.12
# make node_modules   npm's reader of logs, which a test wants; it skips without
# Another Python: make PYTHON=/path/to/python3.12 setup

SHELL := bash
VENV ?= .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.cable_ros_installed
EXTRAS := ros,robot,plot,parquet,docs,dev
LOGS := $(CURDIR)/build/ros_log

# Contact and friction once more with other kernels of BLAS and for no particular processor: no last bit counts.
OTHER_KERNELS := OPENBLAS_CORETYPE=Sandybridge NUMBA_CPU_NAME=generic NUMBA_CPU_FEATURES= \
	NUMBA_CACHE_DIR=$(CURDIR)/build/other_kernels
CONTACT_TESTS := test/test_contact.py test/test_friction.py test/test_lying.py test/test_hose_paths.py \
	test/test_told_finer.py::test_smooth_scenes_at_any_rate \
	test/test_told_finer.py::test_a_lift_laid_down_at_any_rate_lies_up_to_its_clamp \
	test/test_zoo.py -k "not test_zoo or ((ball or ground or hose or box or drum or edge or sides) \
	and not (laid or glitch or grid))"

# What shows most mistakes soonest; nothing of it starts a node or compiles anew what has not changed.
FAST_TESTS := test/linalg test/solve test/scene test/rod test/effects test/contact/test_nodal_tangent.py \
	test/contact/test_distance.py test/test_closed_forms.py test/test_contact.py test/test_tracker.py \
	test/test_layout.py test/test_docs.py

# Tests in this many processes side by side; pytest -n 0, or no -n, is one. test/conftest.py groups them.
WORKERS := 2
# A test that hangs where no signal reaches it, in compiled code or the middleware, ends its process and is told.
PYTEST := $(BIN)/python -m pytest -n $(WORKERS) --durations 25 -o faulthandler_exit_on_timeout=true
COMPILE := $(BIN)/python -m cable_ros.cli.main compile --jobs 1

# Ubuntu 24.04's packages; but matplotlib, 3.6.3 there, has no wheel for Python 3.12 before 3.8, and Numba is the
# oldest that runs on 3.12. Pinocchio is the newest that takes this NumPy.
NOBLE ?= .venv-noble
NOBLE_STAMP := $(NOBLE)/.installed
NOBLE_NUMBA := numba==0.59.1 llvmlite==0.42.0
NOBLE_PINS := numpy==1.26.4 scipy==1.11.4 matplotlib==3.8.0 PyYAML==6.0.1 \
	pytest==7.4.4 pytest-timeout==2.2.0 hypothesis==6.98.15 tqdm==4.66.2
NOBLE_ROS := pin==2.7.0 ros-jazzy-rclpy==7.1.6 ros-jazzy-common-interfaces==5.3.6 \
	'ros-rclpy[fastrtps]==7.1.6' ros-rmw-fastrtps-cpp==8.4.3 ros-sensor-msgs==5.3.6 ros-ament-index-python==1.8.1
NOBLE_OTHERS := $(NOBLE_NUMBA) 'mcap>=1.5' rosbags $(NOBLE_ROS)
# What a robot has before the README's first command: neither Numba nor mcap.
ROBOT ?= .venv-robot
ROBOT_STAMP := $(ROBOT)/.installed
ROBOT_OTHERS := $(NOBLE_ROS) colcon-common-extensions colcon-ros setuptools==68.1.2
NOBLE_TESTS := test/ros test/scene test/log test/test_closed_forms.py test/test_joint.py test/test_tracker.py \
	test/test_requirements.py test/drawing/test_figures.py test/cli/test_plot.py test/cli/test_solve.py

# One thread per process: the solver is single-threaded, and tests start several processes.
export OMP_NUM_THREADS := 1
export OPENBLAS_NUM_THREADS := 1
export ROS_LOG_DIR ?= $(LOGS)
export PIP_DISABLE_PIP_VERSION_CHECK := 1

# The first Python 3.10-3.13 that can make a virtual environment.
find_python = for python in $(PYTHON) python3 python3.12 python3.11 python3.13 python3.10; do \
	"$$python" -c 'import sys, venv, ensurepip; sys.exit(not (3, 10) <= sys.version_info < (3, 14))' \
	2>/dev/null && { command -v "$$python"; break; }; done; true

.PHONY: setup test test-all test-fast test-noble robot lint docs demo clean

setup: $(STAMP)

$(BIN)/python:
	@python=$$($(find_python)); \
	if [ -z "$$python" ]; then \
		echo "make setup needs Python 3.10 to 3.13 with its venv module; on Debian and Ubuntu:" \
			"sudo apt install python3-venv; elsewhere: make PYTHON=/path/to/python3.12 setup" >&2; \
		exit 1; \
	fi; \
	echo "Making $(VENV) with $$("$$python" --version)"; \
	"$$python" -m venv $(VENV) || { rm -rf $(VENV); exit 1; }

$(STAMP): setup.py pyproject.toml | $(BIN)/python
	@echo "Installing cable_ros with ROS 2 Jazzy's wheels into $(VENV): a minute or two"
	$(BIN)/python -m pip install --quiet --upgrade pip
	$(BIN)/python -m pip install --quiet --editable ".[$(EXTRAS)]"
	@touch $@

lint: setup
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

docs: setup
	PYTHONPATH=$(CURDIR) $(BIN)/python docs/reference.py --check
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --quiet

# Without npm, or without its registry, the test that wants this skips.
node_modules:
	@npm install --prefix . --silent --no-save --no-package-lock --fetch-retries=0 --fetch-timeout=20000 \
		@mcap/core@2 fzstd@0.1 2>/dev/null || true

test: lint docs node_modules
	@mkdir -p "$$ROS_LOG_DIR"
	@echo "Compiling for two kinds of kernels: some minutes if the compiled files have changed"
	$(OTHER_KERNELS) $(COMPILE) & other=$$!; $(COMPILE); compiled=$$?; wait $$other && exit $$compiled
	$(PYTEST)
	$(OTHER_KERNELS) $(PYTEST) -p no:cacheprovider $(CONTACT_TESTS)

test-all:
	CABLE_ROS_TESTS=all $(MAKE) test

test-fast: setup
	$(PYTEST) -q $(FAST_TESTS)

$(NOBLE_STAMP) $(ROBOT_STAMP): Makefile
	@python=$$(command -v $(or $(PYTHON),python3.12)); \
	"$$python" -c 'import sys; sys.exit(sys.version_info[:2] != (3, 12))' 2>/dev/null || \
		{ echo "this needs Python 3.12: make PYTHON=/path/to/python3.12 test-noble" >&2; exit 1; }; \
	"$$python" -m venv --clear $(@D)
	@printf '%s\n' $(NOBLE_PINS) $(NOBLE_NUMBA) > $(@D)/pins.txt
	$(@D)/bin/python -m pip install --quiet --constraint $(@D)/pins.txt $(NOBLE_PINS) $(OTHERS)
	@touch $@

$(NOBLE_STAMP): OTHERS = $(NOBLE_OTHERS)
$(ROBOT_STAMP): OTHERS = $(ROBOT_OTHERS)

# Compiled first, as for `test`: a test gives a node too little time to compile all it needs.
test-noble: export PYTHONPATH := $(CURDIR)
test-noble: export NUMBA_CACHE_DIR := $(CURDIR)/build/noble
test-noble: $(NOBLE_STAMP)
	@mkdir -p "$$ROS_LOG_DIR"
	@echo "Compiling with Ubuntu's versions: some minutes if the compiled files have changed"
	$(NOBLE)/bin/python -m cable_ros.cli.main compile
	$(NOBLE)/bin/python -m pytest -p no:cacheprovider --timeout 600 $(NOBLE_TESTS)

robot: $(ROBOT_STAMP)
	@mkdir -p build
	set -o pipefail; .ci/robot $(ROBOT) build/robot 2>&1 | tee build/robot.txt

demo: setup
	@mkdir -p "$$ROS_LOG_DIR"
	$(BIN)/python -m cable_ros.cli.main demo --out demo/

clean:
	rm -rf build install log demo .mypy_cache .ruff_cache .pytest_cache .hypothesis *.egg-info
	find . -name __pycache__ -not -path './$(VENV)/*' -prune -exec rm -rf {} +
