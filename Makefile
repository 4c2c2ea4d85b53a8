# Everything runs in .venv, which these targets make and keep up to date.
# With ROS 2 sourced (ROS_DISTRO set) it uses that installation; without, ROS 2 comes from PyPI.

PYTHON ?= python3
VENV   := .venv
RUN    := $(VENV)/bin/python

ifdef ROS_DISTRO
VENV_FLAGS := --system-site-packages
CONSTRAINTS := constraints-ros.txt
EXTRAS     :=
TEST_EXTRAS := [test,study,peers,docs,dev]
else
VENV_FLAGS :=
CONSTRAINTS := constraints.txt
EXTRAS     := [ros]
TEST_EXTRAS := [ros,test,study,peers,docs,dev]
endif

INSTALL := $(RUN) -m pip install --quiet --disable-pip-version-check -c $(CONSTRAINTS)
NOT_INSTALLED := { echo "not installed: the packages come from PyPI, by way of pip's settings" >&2; exit 1; }

.PHONY: help setup demo study bench faults soak fuzz docs pictures test coverage branches compiled mutants check format bags parameters clean

help:
	@echo "make demo    replay the shipped bag through the tracker, show the scores, write"
	@echo "             out/demo; BAG=three_classes for another of bags/, into"
	@echo "             out/demo_three_classes; PROFILE=air_traffic from the ASTERIX of"
	@echo "             two radars to tracks as ASTERIX; PROFILE=marine, automotive,"
	@echo "             automotive_4d, drone, harbour, own_ship, phd, surveillance:"
	@echo "             other radars and filters; ENGINE=phd for the paper's filter, into"
	@echo "             out/demo_phd"
	@echo "make study   the Monte Carlo study, RUNS=50 (RUNS=12 for a quick one), out/study"
	@echo "make bench   measure speed and scale, BENCH=--quick for a short run, out/bench"
	@echo "make faults  the fault matrix on live nodes, into out/faults;"
	@echo "             PARTS='restarts overload' for some"
	@echo "make soak    a day of scans at full speed, SCANS=1000 for a short run, out/soak"
	@echo "make fuzz    random input for decoders, bags and the live tracker, into out/fuzz"
	@echo "make docs    the documentation as a site, into out/docs"
	@echo "make pictures  the documentation's tables and pictures again, of the demo,"
	@echo "             out/study and out/bench"
	@echo "make test    run the tests"
	@echo "make coverage  the same, with the lines that they run: 90 % of all, 95 % of core"
	@echo "             and adapters"
	@echo "make branches  the branches of the core that its own tests take, and their"
	@echo "             least share"
	@echo "make compiled  tests of compiled functions, with bounds checks, then interpreted"
	@echo "make mutants  mutation tests of the association, the update and the smoother,"
	@echo "             into out/mutants: eight parts in some ten minutes; a part alone"
	@echo "             with PARTS=association, or PARTS='\"gaussian update\" window'"
	@echo "make check   linters, types, and gauges of the structure with their limits"
	@echo "make format  format the code"
	@echo "make bags    write the shipped bags again; they come out byte for byte the same"
	@echo "make parameters  write the reference pages and lists of topics from the code"
	@echo "make setup   only prepare .venv"
	@echo "make clean   remove .venv and everything generated"

setup: $(VENV)/.ready

$(VENV)/.made:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 10))' || \
	    { echo "Python 3.10 or newer is needed; set PYTHON=..."; exit 2; }
	@$(PYTHON) -m venv $(VENV_FLAGS) $(VENV) || \
	    { echo "on Debian and Ubuntu: apt install python3-venv"; exit 2; }
	@touch $@

$(VENV)/.ready: $(VENV)/.made setup.py $(CONSTRAINTS)
	@echo "installing into $(VENV) ..."
	@$(INSTALL) -e '.$(EXTRAS)' || $(NOT_INSTALLED)
	@echo "compiling the engines, a minute or two ..."
	@$(RUN) -m phd_jdtc_ros compile_engines
	@touch $@

$(VENV)/.ready-test: $(VENV)/.ready
	@echo "installing the test tools into $(VENV) ..."
	@$(INSTALL) -e '.$(TEST_EXTRAS)' || $(NOT_INSTALLED)
	@# The decoder that tests compare with has the import name of libasterix: a place of its own.
	@$(INSTALL) --upgrade --target $(VENV)/asterix_decoder asterix_decoder || $(NOT_INSTALLED)
	@touch $@

$(VENV)/.ready-study: $(VENV)/.ready
	@echo "installing what studies and documentation need into $(VENV) ..."
	@$(INSTALL) -e '.[study,peers,docs]' || $(NOT_INSTALLED)
	@touch $@

$(VENV)/.ready-bench: $(VENV)/.ready
	@echo "installing what the benchmark needs into $(VENV) ..."
	@$(INSTALL) -e '.[study,peers]' || $(NOT_INSTALLED)
	@touch $@

demo: $(VENV)/.ready
	@$(RUN) -m phd_jdtc_ros demo $(if $(BAG),--bag $(BAG)) $(if $(PROFILE),--profile $(PROFILE)) \
	    $(if $(ENGINE),--engine $(ENGINE))

RUNS ?= 50

study: $(VENV)/.ready-study
	@$(RUN) -m studies all --runs $(RUNS)

bench: $(VENV)/.ready-bench
	@$(RUN) -m benchmarks $(BENCH)

faults: $(VENV)/.ready-test
	@$(RUN) -m robustness faults $(foreach part,$(PARTS),--part $(part))

SCANS ?= 14400

soak: $(VENV)/.ready-test
	@$(RUN) -m robustness soak --scans $(SCANS)

fuzz: $(VENV)/.ready-test
	@$(RUN) -m robustness fuzz

# The theme's notice of its successor is no fault of a page.
docs: $(VENV)/.ready-study
	@NO_MKDOCS_2_WARNING=1 $(RUN) -m mkdocs build --quiet --strict
	@echo "out/docs/index.html; with its search: python3 -m http.server -d out/docs"

pictures: demo
	@PYTHONPATH=. $(RUN) docs/tools/page_tables.py
	@$(RUN) docs/tools/pictures.py

test: $(VENV)/.ready-test
	$(RUN) test/run.py

# numba imports coverage where it is installed, which delays the start of every process.
coverage: $(VENV)/.ready-test
	@$(INSTALL) -e '.[coverage]' || $(NOT_INSTALLED)
	$(RUN) -m coverage erase
	$(RUN) -m coverage run test/run.py
	$(RUN) -m coverage combine --quiet
	$(RUN) -m coverage report --fail-under=90
	$(RUN) -m coverage report --include='phd_jdtc_ros/c*/*,phd_jdtc_ros/evaluation/*,phd_jdtc_ros/simulation/*,msg_adapters/*' --fail-under=95

# The least share of the lines and branches of the core that its own tests take, in per cent. It only
# rises.
BRANCHES := 96.5

branches: $(VENV)/.ready-test
	@$(INSTALL) -e '.[coverage]' || $(NOT_INSTALLED)
	@mkdir -p out
	$(RUN) -m coverage run --branch --source=phd_jdtc_ros/core --data-file=out/branches \
	    -m pytest -q test/core
	$(RUN) -m coverage combine --quiet --data-file=out/branches out
	$(RUN) -m coverage report --data-file=out/branches --precision=1 --fail-under=$(BRANCHES)

# Code that numba stores is not marked as having bounds checks, so that it has a place of its own.
compiled: $(VENV)/.ready-test
	NUMBA_BOUNDSCHECK=1 NUMBA_CACHE_DIR=$(CURDIR)/out/bounds_checks $(RUN) -m pytest -q test/core
	NUMBA_DISABLE_JIT=1 $(RUN) -m pytest -q test/core/gaussian test/core/association

$(VENV)/.ready-mutants: $(VENV)/.ready-test
	@echo "installing what mutation tests need into $(VENV) ..."
	@$(INSTALL) -e '.[mutants]' || $(NOT_INSTALLED)
	@touch $@

mutants: $(VENV)/.ready-mutants
	$(RUN) test/mutants.py $(PARTS)

check: $(VENV)/.ready-test
	$(RUN) -m ruff check
	$(RUN) -m ruff format --check
	$(RUN) -m mypy
	$(VENV)/bin/lint-imports --no-logo
	$(RUN) -m benchmarks.gauges

format: $(VENV)/.ready-test
	$(RUN) -m ruff check --fix
	$(RUN) -m ruff format

SCENARIOS := paper_scenario clutter_50 one_radar manoeuvring three_classes \
    terminal_radar terminal_radar_by_sector two_terminal_radars two_approach_radars automotive \
    coastal coastal_ship drones cars_4d air_3d two_slant approach_adsb
# What the radars of these would send, as ASTERIX, and what a receiver of AIS would.
RECORDED := two_approach_radars harbour_ais
HEARD := harbour_ais

bags: $(VENV)/.ready
	@for name in $(SCENARIOS); do \
	    rm -rf bags/$$name && \
	    $(RUN) -m phd_jdtc_ros simulate --scenario config/scenarios/$$name.yaml --out bags/$$name \
	    || exit 1; \
	done
	@for name in $(HEARD); do \
	    rm -rf bags/$$name && \
	    $(RUN) -m phd_jdtc_ros simulate --scenario config/scenarios/$$name.yaml --out bags/$$name \
	        --reports bags/$$name/recording.nmea || exit 1; \
	done
	@for name in $(RECORDED); do \
	    $(RUN) -m phd_jdtc_ros asterix_bridge bags/$$name --plots --out bags/$$name/recording.ast \
	    || exit 1; \
	done

parameters: $(VENV)/.ready
	PYTHONPATH=. $(RUN) docs/tools/reference_pages.py docs

clean:
	rm -rf $(VENV) out build install log *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis
