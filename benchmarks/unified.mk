# One law for three kinds of body, and which of them a body is: what docs/unified.md tells. `make unified` makes what is missing.
UNIFIED := docs/results/unified

# the law of all kinds, and its errors on the nine reference objects and on what else laws are asked for
outputs/accuracy/unified/metrics.json: | $(INSTALLED)
	$(RUN) pcnclaws.train experiment=unified_multi output=$(@D) threads=1

$(UNIFIED)/training.json: outputs/accuracy/unified/metrics.json
	@mkdir -p $(@D) && cp $< $@

unified_tasks := reconstruction geometry unseen_motion
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

# the nine objects, each as if it were of each kind
$(UNIFIED)/which_material.json: | $(INSTALLED)
	$(RUN) benchmarks problem=which_material output=$(UNIFIED)

.PHONY: unified
unified: $(UNIFIED)/training.json $(unified_tasks:%=$(UNIFIED)/%.json) $(UNIFIED)/between_kinds.json $(UNIFIED)/which_material.json ## train and measure one law for three kinds of body
