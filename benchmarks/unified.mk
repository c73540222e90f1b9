# One law for three kinds of body, and which of them a body is: what docs/unified.md tells. `make unified` makes what is missing.
UNIFIED := docs/results/unified
KINDS := elasticity plasticine sand

# the law of all kinds, and its errors on the nine reference objects and on what else laws are asked for
outputs/accuracy/unified/metrics.json: | $(INSTALLED)
	$(RUN) pcnclaws.train experiment=unified_multi output=$(@D) threads=1

$(UNIFIED)/training.json: outputs/accuracy/unified/metrics.json
	@mkdir -p $(@D) && cp $< $@

unified_tasks := unseen reconstruction geometry unseen_motion
define unified_task
$(UNIFIED)/$(1).json: outputs/accuracy/unified/metrics.json
	$$(RUN) pcnclaws.evaluate material=unified law=outputs/accuracy/unified task=$(1) threads=1 \
		output=outputs/accuracy/unified/evaluation/$(1).json picture=false may_diverge=true floor=false
	@mkdir -p $$(@D) && cp outputs/accuracy/unified/evaluation/$(1).json $$@

endef
$(foreach task,$(unified_tasks),$(eval $(call unified_task,$(task))))

# bodies between the kinds
$(UNIFIED)/between_kinds.json: outputs/accuracy/unified/metrics.json
	$(RUN) benchmarks problem=between_kinds problem.law=outputs/accuracy/unified output=$(UNIFIED)

# Every object as if it were of each kind, without a guess, from the first 300 steps: all particles, whose start velocity is known, and a hundred
# markers on the surface with 1 mm of noise and gaps, whose start velocity is not.
asked := 'observation.window=[0,0.15]' screening=8 estimator.iterations=6
define seen_of_which
$(SEEN)/$(1)_all.csv: | $(SEEN)/$(1).h5
	$$(RUN) pcnclaws.observe file=$(SEEN)/$(1).h5 every=10 picture=false output=$$@

$(foreach kind,$(KINDS),$(call which,$(1),$(kind),all,$(motion_$(call number_of,$(1)))))
$(foreach kind,$(KINDS),$(call which,$(1),$(kind),markers))
endef

# $(call which,object,kind,observation,options)
define which

$(UNIFIED)/$(3)/$(1)/$(2).json: | $(SEEN)/$(1)_$(3).csv
	$$(RUN) pcnclaws.estimate material=$(2) law=pretrained observation.file=$(SEEN)/$(1)_$(3).csv scene.shape=cube $(paper) $(asked) $(4) \
		threads=1 trajectory=false picture=false output=$(SEEN)/which/$(3)/$(1)/$(2).json
	@mkdir -p $$(@D) && cp $(SEEN)/which/$(3)/$(1)/$(2).json $$@

endef
$(foreach object,$(nine),$(eval $(call seen_of_which,$(object))))

which_all := $(foreach object,$(nine),$(KINDS:%=$(UNIFIED)/all/$(object)/%.json))
which_markers := $(foreach object,$(nine),$(KINDS:%=$(UNIFIED)/markers/$(object)/%.json))

.PHONY: unified which-material
which-material: $(which_all) $(which_markers) ## ask of the paper's nine objects which material they are of
unified: $(UNIFIED)/training.json $(unified_tasks:%=$(UNIFIED)/%.json) $(UNIFIED)/between_kinds.json which-material ## train and measure one law for three kinds of body
